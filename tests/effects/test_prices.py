"""Predicted prices: closed forms at their limits, the fit against known laws."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cnca.effects.catalog import EFFECTS
from cnca.effects.effect import Model
from cnca.effects.fog import fog_share
from cnca.effects.prices import QUANTILE, fit, shipped_prices
from cnca.effects.subject import Subject, mean_over_area
from cnca.scene.materials import MATERIALS
from cnca.scene.weather import Fog, Weather
from cnca.vehicle.model import Part, Vehicle

SUBJECT = Subject(
    Weather(),
    ground=0.2,
    paint=0.3,
    fog_path=8.0,
    pixels_per_metre=30.0,
    amounts={"materials": 1.0, "glass": 0.0},
)


def error(effect: str, model: Model, subject: Subject = SUBJECT) -> float:
    """Predicted by the prices that ship."""
    return EFFECTS[effect].error(model, subject, shipped_prices())


def with_weather(**keys) -> Subject:
    return replace(SUBJECT, weather=Weather(**keys))


def test_fog_takes_nothing_in_its_limits_and_all_when_thick():
    assert fog_share(SUBJECT) == 0
    assert fog_share(with_weather(fog=Fog(10, height=0))) == 0
    assert fog_share(with_weather(fog=Fog(1e12))) < 1e-7
    assert fog_share(with_weather(fog=Fog(0.1))) == pytest.approx(1)
    shares = [fog_share(with_weather(fog=Fog(v))) for v in (30, 100, 1000, 50_000)]
    assert shares == sorted(shares, reverse=True)


@pytest.mark.parametrize("name", EFFECTS)
def test_the_best_that_a_scene_has_a_use_for_has_no_error(name):
    """Such as no lamps where there are none: measured, that model stands for lamps left out."""
    for subject in (SUBJECT, with_weather(fog=Fog(100)), with_weather(sun_altitude=-10)):
        effect = EFFECTS[name]
        assert not effect.has_bias or error(name, effect.present(subject)[-1], subject) == 0


def test_share_of_the_sun():
    assert with_weather(sun_altitude=-1).sun_share == 0
    assert with_weather(sun_scale=0).sun_share == 0
    assert with_weather(sky_scale=0).sun_share == pytest.approx(1)
    assert with_weather(sun_altitude=60).sun_share > with_weather(sun_altitude=3).sun_share
    assert with_weather(fog=Fog(20)).sun_share < 1e-4


def test_coat_counts_by_area():
    flat = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [3, 0, 0], [0, 1, 0]], dtype=float)
    parts = [
        Part(name, name, flat, np.array([corners]), np.tile([0.0, 0.0, 1.0], (5, 1)), None)
        for name, corners in (("paint", [0, 3, 4]), ("tyre", [0, 1, 2]))
    ]
    matt = replace(MATERIALS["paint"], clearcoat=0.0)

    def coat(vehicle: Vehicle) -> float:
        return mean_over_area(vehicle, lambda material: material.clearcoat)

    assert coat(Vehicle("flat", tuple(parts))) == pytest.approx(0.75)
    assert coat(Vehicle("flat", tuple(parts), matt)) == 0


def test_features_are_finite_for_every_sun_and_fog():
    for altitude in (-90, -1e-9, 0, 1e-9, 90):
        for fog in (None, Fog(1e-3), Fog(1e12), Fog(10, height=0)):
            subject = replace(with_weather(sun_altitude=altitude, fog=fog), ground=0, paint=0)
            assert np.isfinite([*subject.features(), fog_share(subject)]).all()


def test_the_fit_finds_a_power_law_and_stays_above_nine_of_ten():
    rng = np.random.default_rng(0)
    features = np.stack([np.ones(400), rng.normal(size=400), rng.normal(size=400)], axis=1)
    law = features @ [math.log(0.05), 1.5, -0.5]
    errors = np.exp(law + 0.3 * rng.normal(size=400))
    found = fit(features.tolist(), errors.tolist())
    np.testing.assert_allclose(found.weights, [math.log(0.05), 1.5, -0.5], atol=0.06)
    covered = np.mean([found.error(x) >= e for x, e in zip(features.tolist(), errors, strict=True)])
    assert covered == pytest.approx(QUANTILE, abs=0.01)


def test_shipped_prices_are_those_of_a_renderer():
    """What must hold of any measurement: better models err less, cost more."""
    prices = shipped_prices()
    bounces = [error("interreflection", n) for n in (1, 2, 3, 4, 8)]
    assert bounces == sorted(bounces, reverse=True)
    assert error("materials", "diffuse") > error("materials", "principled")
    assert error("fog", "none") == 0
    assert error("sun", "direction", with_weather(sun_altitude=-5)) == 0
    assert prices.noise_of(64, SUBJECT) < prices.noise_of(16, SUBJECT) < 1
    rate = -prices.noise.weights[-1]
    assert 0.4 < rate < 1, "between independent and well-spread samples"
    assert prices.seconds["rays"] > 0


@pytest.mark.parametrize("noise", [0.5, 0.1, 0.02])
def test_samples_suffice_for_the_noise_and_half_of_them_do_not(noise):
    prices = shipped_prices()
    samples = prices.samples_for(noise, SUBJECT, 2**30)
    assert prices.noise_of(samples, SUBJECT) <= noise * 1.0001
    assert samples == 1 or prices.noise_of(samples // 2, SUBJECT) > noise
    assert prices.samples_for(noise, SUBJECT, 4) <= 4
