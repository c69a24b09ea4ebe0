"""Fog against Beer and Lambert, conservation of energy, mirror images, and clear air."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.hard.looks import DIFFERENT, Stage, largest_z, look


@pytest.mark.parametrize("name", ["fog_visibility_1e9_m", "fog_thin_sheet"])
def test_fog_that_is_hardly_there_cannot_be_seen(name):
    assert largest_z(look("plain").images, look(name).images) < DIFFERENT


def test_a_haze_of_50_km_can_be_seen_but_hardly():
    """Which shows too that the comparison above can fail."""
    clear, haze = look("plain").images, look("fog_visibility_50_km").images
    assert largest_z(clear, haze) > DIFFERENT
    np.testing.assert_allclose(haze.mean(), clear.mean(), rtol=0.02)


def test_a_layer_without_height_is_clear_air():
    np.testing.assert_array_equal(look("fog_zero_height").image, look("plain").image)


def test_paint_fades_by_beer_and_lambert_in_droplets_that_only_absorb():
    """One camera is a metre further away than the other."""
    seen = look("fog_absorbing")
    near, far = seen.contrast
    assert far / near == pytest.approx(np.exp(-seen.weather.fog.extinction), rel=1e-3)


@pytest.mark.parametrize("name", ["100_m", "10_m", "1_m"])
def test_paint_fades_less_than_that_where_droplets_scatter(name):
    """A wall fills half of what a droplet sees, so it gives back at most half of the loss."""
    seen = look(f"fog_visibility_{name}")
    fog, (near, far) = seen.weather.fog, seen.contrast
    assert -np.log(far / near) < 1.001 * fog.extinction
    assert -np.log(far / near) > 0.999 * fog.extinction * (1 - fog.albedo / 2)


@pytest.mark.parametrize("name", ["fog_visibility_10_cm", "fog_pitch_dark", "fog_conserving"])
def test_thick_fog_hides_the_vehicle(name):
    assert look(name).contrast == 0
    assert (look(name).gradients == 0).all()


def test_fog_that_lets_nothing_through_is_black():
    """Not lifted by the exposure: what is left is rounding, far below the darkest display."""
    assert look("fog_pitch_dark").images.max() < 1e-12


def test_light_that_nothing_absorbs_is_the_same_everywhere_in_deep_fog():
    """No net flux, so the radiance is isotropic and the meter's white card is as bright as all."""
    images = look("fog_conserving").images
    color = images.mean(axis=(0, 1, 3, 4))
    assert largest_z(images, np.broadcast_to(color[:, None, None], images.shape)) < DIFFERENT
    assert color.mean() == pytest.approx(1, rel=1e-3)


@pytest.mark.parametrize(("name", "in_fog"), [("inside", 1.9), ("on_top", 2.0), ("above", 2.0)])
def test_only_the_path_inside_the_layer_counts(name, in_fog):
    """``in_fog`` metres of layer lie between the two cameras."""
    seen = look(f"fog_camera_{name}")
    low, high = seen.contrast
    expected = np.exp(-seen.weather.fog.extinction * in_fog)
    assert high / low == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("name", ["fog_forward", "fog_backward", "fog_sun_grazing"])
def test_left_and_right_of_the_sun_look_the_same(name):
    left, right = np.moveaxis(look(name).images, 1, 0)
    assert largest_z(left, right[..., ::-1]) < DIFFERENT


def test_a_night_in_fog_is_darker_than_dusk_in_fog():
    dusk = Stage("fog_night")
    dusk.weather = replace(dusk.weather, sun_altitude=0.0)
    assert 0.03 < look("fog_night").image.mean() / dusk.images().numpy().mean() < 0.1
