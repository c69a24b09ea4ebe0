"""Caustics: bounding them takes the specks away, and next to none of the light."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from cnca.core.types import LinearTexture
from cnca.effects.plan import Demand
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.scene.cameras import View, orbit_view
from cnca.scene.weather import Weather
from cnca.vehicle.builtin.sedan import BUILTIN_VEHICLES, build_sedan

WEATHER = Weather(sun_altitude=45, sun_azimuth=75)
VIEW: View = orbit_view(35, 12, 7.5, fov=45, width=96, height=96)
ALBEDO = LinearTexture(torch.full((3, 8, 8), 0.4))
COUNT = 16


@pytest.fixture(scope="module")
def sedan() -> MitsubaRenderer:
    """The sedan, whose lacquer and rims throw the sun onto the ground."""
    return MitsubaRenderer(build_sedan(BUILTIN_VEHICLES["sedan"], "sedan"), texture_size=8)


@pytest.fixture(scope="module")
def bounded(sedan) -> np.ndarray:
    return pictures(sedan, 64, COUNT, caustics="regularised")


@pytest.fixture(scope="module")
def kept(sedan) -> np.ndarray:
    return pictures(sedan, 64, COUNT, caustics="kept")


@pytest.fixture(scope="module")
def ground(sedan) -> np.ndarray:
    """Pixels that show nothing of the vehicle."""
    return sedan.vehicle_mask([VIEW])[0] == 0


def pictures(renderer: MitsubaRenderer, samples: int, count: int, **forced: str) -> np.ndarray:
    """Independent pictures in linear RGB, (count, 3, height, width)."""
    demand = Demand(forced={"samples": samples, **forced})
    drawn = [
        renderer.render(ALBEDO, [VIEW], WEATHER, seed=seed, demand=demand) for seed in range(count)
    ]
    return torch.cat(drawn).numpy()


def test_matt_surfaces_have_none(sedan):
    """White matt card reflects 1/π, the lowest bound, so no matt surface meets a bound."""
    unbounded, *others = (
        pictures(sedan, 16, 1, materials="diffuse", caustics=model)
        for model in ("kept", "regularised", "off")
    )
    for other in others:
        np.testing.assert_allclose(other, unbounded, rtol=1e-6)


def test_bounds_take_most_of_the_noise_of_the_ground_and_keep_the_light(ground, bounded, kept):
    before, after = (each.var(axis=0, ddof=1)[:, ground].mean() for each in (kept, bounded))
    assert after < 0.5 * before
    loss = 1 - bounded.mean() / kept.mean()
    error = kept.mean(axis=(1, 2, 3)).std(ddof=1) / COUNT**0.5 / kept.mean()
    assert -4 * error < loss < 0.005 + 4 * error


def speck_count(picture: np.ndarray, others: np.ndarray, where: np.ndarray) -> int:
    """Pixels that are 5 deviations of their neighbours off the mean of many other pictures."""
    padded = np.pad(others.std(axis=0, ddof=1), 2, mode="reflect")
    around = np.lib.stride_tricks.sliding_window_view(padded, (5, 5)).mean(axis=(-2, -1))
    return int((np.abs(picture - others.mean(axis=0)) > 5 * around + 0.01)[where].sum())


def test_no_specks_on_the_ground_at_64_rays(ground, bounded, kept):
    gray = bounded.mean(axis=1)
    assert speck_count(gray[0], gray[1:], ground) == 0
    assert speck_count(kept[0].mean(axis=0), gray[1:], ground) > 0
