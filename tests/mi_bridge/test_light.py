"""Sun, sky and the light meter."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from cnca.mi_bridge.light import (
    SUN_HALF_ANGLE,
    lambertian_white,
    make_light,
    sky_directions,
    sky_solid_angles,
)
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.mi_bridge.sky import Sky
from cnca.scene.cameras import View
from cnca.scene.weather import Weather
from tests.mi_bridge.conftest import uniform_light

GROUND = np.full(3, 0.2)
ALTITUDES = (-90, -18, -6, -0.01, 0, 0.01, 1, 5, 15, 30, 60, 90)


@pytest.mark.parametrize("altitude", ALTITUDES)
@pytest.mark.parametrize("turbidity", [1, 10])
def test_light_is_finite_and_not_negative(altitude, turbidity):
    light = make_light(Weather(sun_altitude=altitude, turbidity=turbidity), GROUND)
    for values in (light.sun_irradiance, light.sky):
        assert np.isfinite(values).all()
        assert (values >= 0).all()
    assert np.linalg.norm(light.sun_direction) == pytest.approx(1)


def test_a_higher_sun_is_brighter_and_a_lower_one_redder():
    irradiance = np.array(
        [make_light(Weather(sun_altitude=a), GROUND).sun_irradiance for a in (5, 15, 40, 80)]
    )
    assert (np.diff(irradiance, axis=0) > 0).all()
    assert (np.diff(irradiance[:, 0] / irradiance[:, 2]) < 0).all()


def test_dusk_darkens_the_sky_without_a_jump():
    def mean_sky(altitude: float) -> float:
        return float(make_light(Weather(sun_altitude=altitude), GROUND).sky[:64].mean())

    levels = [mean_sky(a) for a in (0.0, -1.0, -6.0, -12.0, -18.0)]
    assert (np.diff(levels) < 0).all()
    assert mean_sky(-0.01) == pytest.approx(mean_sky(0.0), rel=0.02)


@pytest.mark.parametrize(
    ("weather", "expected"),
    [
        (Weather(sun_altitude=-1), False),
        (Weather(sun_altitude=0), False),
        (Weather(sun_altitude=1), True),
        (Weather(sun_scale=0), False),
    ],
)
def test_there_is_a_sun_only_above_the_horizon(weather, expected):
    assert Sky(make_light(weather, GROUND)).has_sun is expected


def test_the_sun_is_about_as_bright_beside_the_sky_as_on_a_clear_day():
    """Direct to diffuse irradiance at 45° is between 3 and 12 in clear air (textbook values)."""
    light = make_light(Weather(sun_altitude=45, turbidity=3), GROUND)
    cosine = sky_directions(128, 256)[..., 2].clip(min=0) * sky_solid_angles(128, 256)
    diffuse = (light.sky * cosine[..., None]).sum(axis=(0, 1)).mean()
    direct = light.sun_irradiance.mean() * light.sun_direction[2]
    assert 3 < direct / diffuse < 12
    assert np.degrees(SUN_HALF_ANGLE) == pytest.approx(0.267, abs=0.005)


def test_the_ground_below_the_horizon_reflects_what_falls_on_it():
    black = make_light(Weather(), np.zeros(3))
    assert (black.sky[64:] == 0).all()
    grey, white = (make_light(Weather(), np.full(3, a)).sky[64:] for a in (0.5, 1.0))
    np.testing.assert_allclose(white, 2 * grey)


def test_scales_are_factors():
    one, double = (make_light(Weather(sun_scale=s, sky_scale=s), np.zeros(3)) for s in (1.0, 2.0))
    np.testing.assert_allclose(double.sky, 2 * one.sky)
    np.testing.assert_allclose(double.sun_irradiance, 2 * one.sun_irradiance)


def test_solid_angles_fill_the_sphere():
    assert 256 * sky_solid_angles(128, 256).sum() == pytest.approx(4 * np.pi)


def test_the_meter_in_a_uniform_sky_reads_its_radiance():
    light = uniform_light(2.5)
    white = lambertian_white(light.sky, light.sun_irradiance, light.sun_direction)
    assert white == pytest.approx(2.5, rel=1e-3)


@pytest.mark.parametrize(("altitude", "share"), [(90, 0.5), (45, np.sqrt(0.5)), (0, 0.5)])
def test_the_meter_under_sun_alone_obeys_lamberts_law(altitude, share):
    """The mean of sin and cos of the altitude: one card lies, the other stands."""
    a = np.radians(altitude)
    sun = np.array([np.cos(a), 0, np.sin(a)])
    white = lambertian_white(np.zeros((4, 8, 3)), np.full(3, np.pi), sun)
    assert white == pytest.approx(share)


@pytest.mark.parametrize("albedo", [0.05, 0.18, 0.6])
def test_matt_ground_of_albedo_a_is_exposed_to_about_a(vehicle, albedo):
    renderer = MitsubaRenderer(
        vehicle, ground_albedo=[albedo] * 3, texture_size=8, samples=64, bounces=1
    )
    away = View("ground", (40.0, 40.0, 3.0), (40.0, 40.0, 0.0), (1.0, 0.0, 0.0), 40.0, 8, 8)
    image = renderer.render(torch.full((3, 8, 8), 0.5), [away], Weather(sun_altitude=45), seed=0)
    assert float(image.mean()) == pytest.approx(albedo, rel=0.15)
