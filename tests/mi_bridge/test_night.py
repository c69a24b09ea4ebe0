"""Dusk and night against published illuminances, and exposure that leaves nights dark."""

import numpy as np
import pytest

from cnca.core.photometry import CANDELAS
from cnca.mi_bridge.light import make_light
from cnca.mi_bridge.night import TWILIGHT, exposure_at_night, twilight
from cnca.scene.environment import level_weights
from cnca.scene.weather import Weather

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def lux(altitude: float) -> float:
    """On level ground under the clear sky."""
    light = make_light(Weather(sun_altitude=altitude), np.zeros(3))
    weights = level_weights(*light.sky.shape[:2])[..., None]
    return float((light.sky * weights).sum(axis=(0, 1)) @ LUMINANCE * CANDELAS)


@pytest.mark.parametrize(
    ("altitude", "low", "high"),
    [(-6, 2.0, 3.5), (-12, 0.006, 0.012), (-18, 1e-3, 2e-3), (-90, 9e-4, 1.1e-3)],
)
def test_the_sky_after_sunset_is_as_bright_as_published(altitude, low, high):
    """The AMS Glossary's twilights; from −18° on starlight is more than they are."""
    assert low < lux(altitude) < high


def test_twilight_falls_with_the_sun_without_a_step():
    altitudes = np.linspace(0, -90, 901)
    shares = np.array([twilight(a) for a in altitudes])
    assert shares[0] == 1
    assert (np.diff(shares) < 0).all()
    assert (shares[1:] > 0.75 * shares[:-1]).all()


def test_exposure_is_the_meters_by_day_and_falls_with_the_light_at_night():
    sunset = TWILIGHT[0][1] / np.pi / CANDELAS
    assert exposure_at_night(1e-9, 0.0) == 1
    assert exposure_at_night(sunset, -1e-6) == pytest.approx(1, abs=1e-3)
    whites = sunset * np.logspace(0, -8, 40)
    factors = [exposure_at_night(white, -20.0) for white in whites]
    assert (np.diff(factors) <= 0).all()
    # Shown luminance still rises with the light.
    assert min(factors) > 0.04
