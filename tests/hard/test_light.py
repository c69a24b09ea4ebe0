"""Sun and sky against Lambert's law, rotation, mirror images, and the exposure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_erosion, maximum_filter, minimum_filter

from tests.hard.looks import (
    DIFFERENT,
    SEEDS,
    Stage,
    look,
    pixel_directions,
    sky_towards,
)

ALTITUDES = ("90", "10", "0_1", "0", "minus_0_1", "minus_18", "minus_90")


@pytest.mark.parametrize("altitude", ALTITUDES)
def test_open_ground_obeys_lamberts_law(altitude):
    """Its radiance is ρ/π times the irradiance, with which the sky map goes on below the ground."""
    seen = look(f"sun_altitude_{altitude}")
    pixels = seen.images[:, 1].mean(axis=(2, 3))
    error = pixels.std(axis=0, ddof=1) / np.sqrt(SEEDS)
    # A texel of the map is 1.4° high: its sum over directions is exact to 0.1 %.
    expected = seen.light.sky[-1, 0]
    assert (np.abs(pixels.mean(axis=0) - expected) < DIFFERENT * error + 1e-3 * expected).all()


def test_sunset_has_no_step():
    found, expected = look("sun_altitude_minus_0_1").image, look("sun_altitude_0").image
    np.testing.assert_allclose(found, expected, rtol=0.08)


@pytest.mark.parametrize("altitude", ["minus_18", "minus_90"])
def test_a_night_without_lamps_is_dark_and_not_black(altitude):
    night, sunset = look(f"sun_altitude_{altitude}").image, look("sun_altitude_0").image
    assert 0.03 < night.mean() / sunset.mean() < 0.1


def test_the_sky_of_the_deepest_night_is_even():
    seen = look("sun_altitude_minus_90")
    sky = seen.light.sky[: len(seen.light.sky) // 2]
    np.testing.assert_allclose(sky, sky.max(), rtol=1e-6)


def test_a_sun_in_the_zenith_has_no_azimuth():
    turned = Stage("sun_altitude_90")
    turned.weather = replace(turned.weather, sun_azimuth=77.0)
    np.testing.assert_allclose(look("sun_altitude_90").image, turned.images(), atol=1e-4)


@pytest.mark.parametrize("azimuth", ["90", "180", "270", "720"])
def test_a_scene_that_turns_as_a_whole_looks_the_same(azimuth):
    still, turned = look("sun_azimuth_0"), look(f"sun_azimuth_{azimuth}")
    np.testing.assert_allclose(still.images, turned.images, atol=1e-4)
    np.testing.assert_allclose(still.gradients, turned.gradients, atol=1e-6)


def test_a_million_times_the_light_is_exposed_to_the_same_picture():
    np.testing.assert_allclose(look("sun_scale_1e6").image, look("plain").image, rtol=1e-4)


@pytest.mark.parametrize("name", ["light_none", "sky_map_black"])
def test_no_light_is_black(name):
    assert (look(name).images == 0).all()
    assert (look(name).gradients == 0).all()


def test_the_same_light_from_everywhere_hides_the_horizon():
    """White card is 1 in it, and so is everything else but the vehicle and the shade around it."""
    seen = look("sky_map_one_texel")
    image, depth = seen.image[0], seen.layers.depth[0]
    far = ~(depth < 20) & (seen.layers.mask[0] == 0)
    assert far.sum() > 50
    np.testing.assert_allclose(image[:, far], 1, rtol=1e-3)
    assert 0 < image[:, seen.layers.mask[0] == 1].mean() < 1


def test_a_sun_of_a_million_leaves_no_specks():
    """It is one direction: what it lights is at most as bright as white card that faces it."""
    seen = look("sky_map_sun_1e6")
    assert seen.weather.sun_altitude == pytest.approx(43.6, abs=0.1)
    depth = seen.layers.depth[0]
    sky = seen.image[0][:, np.isinf(depth)]
    white = seen.light.sun_irradiance / np.pi + seen.light.sky[0, 0]
    assert np.unique(sky.round(4)).size <= 2, "the sky and what the map has below it"
    assert seen.images[:, 0, :, seen.layers.mask[0] == 1].max() < 1.2 * white.max()


def test_against_the_sun_the_sky_is_the_sky_map():
    """A pixel is 2° wide, a texel 1.4°: it lies between extremes of the 5 × 5 texels there."""
    seen = look("sun_in_picture")
    in_sight = binary_erosion(np.isinf(seen.layers.depth[0]), border_value=1)
    found = seen.images[:, 0].mean(axis=0).transpose(1, 2, 0)[in_sight]
    towards = pixel_directions(seen.views[0])[in_sight]

    def fits(sky: np.ndarray) -> bool:
        around = {"size": (5, 5, 1), "mode": ("nearest", "wrap", "nearest")}
        low, high = (extreme(sky, **around) for extreme in (minimum_filter, maximum_filter))
        inside = (found > sky_towards(low, towards)) & (found < sky_towards(high, towards))
        return bool(inside.all())

    sky = seen.light.sky
    assert len(found) > 100
    assert fits(sky)
    assert not fits(np.roll(sky, 4, axis=1))  # the sun 6° further


def test_with_the_sun_behind_the_camera_no_shadow_is_in_sight():
    """Under a black sky all ground in sight has the sun's full E sin α, or more by reflections."""
    seen = look("sun_behind_camera")
    ground = binary_erosion((seen.layers.mask[0] == 0) & (seen.layers.depth[0] < 100))
    light = seen.light
    expected = seen.ground_albedo / np.pi * light.sun_irradiance * light.sun_direction[2]
    found = seen.image[0].transpose(1, 2, 0)[ground]
    assert len(found) > 100
    assert (found > 0.999 * expected).all()
    np.testing.assert_allclose(np.median(found, axis=0), expected, rtol=1e-3)
