"""Colors of sun and sky by the sun's altitude, against colour-science."""

from __future__ import annotations

import colour
import numpy as np
import pytest

from cnca.mi_bridge.light import make_light, sky_directions, sky_solid_angles
from cnca.scene.weather import Weather

GROUND = np.full(3, 0.2)
SHAPE = colour.SpectralShape(380, 780, 5)
ALTITUDES = (5, 10, 20, 40, 60, 90)


def chromaticity(linear_rgb: np.ndarray) -> np.ndarray:
    return colour.XYZ_to_xy(colour.RGB_to_XYZ(linear_rgb, "sRGB", apply_cctf_decoding=False))


def temperature(xy: np.ndarray) -> float:
    return float(colour.xy_to_CCT(xy, "McCamy 1992"))


def through_air(altitude: float) -> np.ndarray:
    """A black body of the sun's 5778 K behind air without dust or ozone (Kasten & Young 1989)."""
    air_mass = 1 / (np.sin(np.radians(altitude)) + 0.50572 * (6.07995 + altitude) ** -1.6364)
    depth = colour.phenomena.sd_rayleigh_scattering(SHAPE).values
    spectrum = colour.sd_blackbody(5778, SHAPE).values * np.exp(-depth * air_mass)
    return colour.XYZ_to_xy(colour.sd_to_XYZ(colour.SpectralDistribution(spectrum, SHAPE)))


@pytest.mark.parametrize("altitude", ALTITUDES)
def test_the_sun_has_the_color_of_a_black_body_behind_air(altitude):
    """Ozone and dust, which that lacks, make it redder by up to a tenth."""
    light = make_light(Weather(sun_altitude=altitude, turbidity=1), GROUND)
    ours, expected = chromaticity(light.sun_irradiance), through_air(altitude)
    assert 0.9 * temperature(expected) < temperature(ours) < temperature(expected)
    assert np.abs(ours - expected).max() < 0.025


@pytest.mark.parametrize("altitude", [10, 20, 40, 60, 90])
@pytest.mark.parametrize("turbidity", [1, 3])
def test_sun_and_sky_together_lie_on_the_daylight_locus(altitude, turbidity):
    light = make_light(Weather(sun_altitude=altitude, turbidity=turbidity), GROUND)
    rows, columns = light.sky.shape[:2]
    up = sky_solid_angles(rows, columns) * sky_directions(rows, columns)[..., 2].clip(min=0)
    irradiance = (light.sky * up[..., None]).sum(axis=(0, 1))
    irradiance += light.sun_irradiance * np.sin(np.radians(altitude))
    xy = chromaticity(irradiance)
    assert 5500 < temperature(xy) < 6500
    daylight = colour.temperature.CCT_to_xy_CIE_D(temperature(xy))
    assert np.linalg.norm(xy - daylight) < 0.015


@pytest.mark.parametrize("altitude", ALTITUDES)
def test_the_zenith_is_bluer_than_any_daylight(altitude):
    sky = make_light(Weather(sun_altitude=altitude, turbidity=1), GROUND).sky
    assert temperature(chromaticity(sky[:8].mean(axis=(0, 1)))) > 10_000
