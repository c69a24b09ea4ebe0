"""Drawn views and weathers: within their ranges, evenly spread, known by their index."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import qmc

from cnca.scene.schema import Scene
from cnca.scene.variation import draw_views, draw_weathers, in_blocks

SCENE = Scene.model_validate(
    {
        "fog": {"visibility": 80, "height": 30, "albedo": 0.9},
        "sky": {"turbidity": 5},
        "variation": {
            "azimuth": [10, 250],
            "elevation": [5, 40],
            "distance": [6, 12],
            "sun_altitude": [-5, 60],
            "sun_azimuth": [90, 180],
            "visibility": [20, 400],
        },
        "image": {"width": 40, "height": 30},
    }
)


def spherical(view) -> tuple[float, float, float]:
    """Azimuth and elevation in degrees and distance, from the camera's position."""
    x, y, z = np.array(view.origin) - view.target
    distance = float(np.sqrt(x * x + y * y + z * z))
    return (
        float(np.degrees(np.arctan2(y, x)) % 360),
        float(np.degrees(np.arcsin(z / distance))),
        distance,
    )


def test_chunks_join_to_the_same_views():
    whole = draw_views(SCENE, 8, seed=3)
    assert whole == draw_views(SCENE, 4, seed=3) + draw_views(SCENE, 4, seed=3, start=4)
    singly = [draw_views(SCENE, 1, seed=3, start=i)[0] for i in range(8)]
    assert whole == singly


def test_a_longer_draw_of_weathers_begins_like_a_shorter_one():
    assert draw_weathers(SCENE, 8, seed=3)[:5] == draw_weathers(SCENE, 5, seed=3)


def test_other_seeds_draw_others():
    assert draw_views(SCENE, 4, seed=1) != draw_views(SCENE, 4, seed=2)
    assert draw_weathers(SCENE, 4, seed=1) != draw_weathers(SCENE, 4, seed=2)


def test_views_stay_in_their_ranges_and_fill_them():
    views = draw_views(SCENE, 64, seed=0)
    assert all((v.width, v.height, v.fov) == (40, 30, 45) for v in views)
    drawn = np.array([spherical(v) for v in views]).T
    for values, (low, high) in zip(drawn, [(10, 250), (5, 40), (6, 12)], strict=True):
        assert values.min() >= low - 1e-6
        assert values.max() <= high + 1e-6
        counts = np.histogram(values, bins=8, range=(low, high))[0]
        assert counts.min() == counts.max() == 8  # what a Sobol sequence promises


def test_weathers_stay_in_their_ranges_and_keep_the_rest():
    weathers = draw_weathers(SCENE, 32, seed=0)
    assert all(-5 <= w.sun_altitude <= 60 and 90 <= w.sun_azimuth <= 180 for w in weathers)
    assert all(20 <= w.fog.visibility <= 400 for w in weathers)
    assert {(w.fog.height, w.fog.albedo, w.turbidity) for w in weathers} == {(30, 0.9, 5)}


def test_visibility_is_spread_evenly_in_extinction():
    extinction = [w.fog.extinction for w in draw_weathers(SCENE, 64, seed=0)]
    low, high = 3.912 / 400, 3.912 / 20
    assert np.mean(extinction) == pytest.approx((low + high) / 2, rel=0.02)


def test_without_a_range_of_visibility_the_fog_is_the_scenes_own():
    clear, foggy = (
        Scene.model_validate({"variation": {}, "fog": fog}) for fog in (None, {"visibility": 50})
    )
    assert all(w.fog is None for w in draw_weathers(clear, 3, seed=0))
    assert all(w.fog.visibility == 50 for w in draw_weathers(foggy, 3, seed=0))


def test_a_range_of_one_value_draws_that_value():
    scene = Scene.model_validate({"variation": {"distance": [7, 7], "azimuth": [90, 90]}})
    for view in draw_views(scene, 5, seed=0):
        assert spherical(view)[2] == pytest.approx(7)
        assert spherical(view)[0] == pytest.approx(90)


@pytest.mark.parametrize("start", [0, 5])
def test_nothing_can_be_drawn(start):
    assert draw_views(SCENE, 0, seed=0, start=start) == []
    assert draw_weathers(SCENE, 0, seed=0) == []


def unit(views) -> np.ndarray:
    """Views as points of the unit cube."""
    low, high = np.array([(10, 250), (5, 40), (6, 12)]).T
    return ((np.array([spherical(v) for v in views]) - low) / (high - low)).clip(0, 1)


@pytest.mark.parametrize("seed", range(4))
def test_views_are_spread_more_evenly_than_at_random(seed):
    """Also the views of one weather, which are a block of the sequence."""
    views, chance = draw_views(SCENE, 256, seed=seed), np.random.default_rng(seed)
    random = [qmc.discrepancy(chance.random((256, 3))) for _ in range(100)]
    assert qmc.discrepancy(unit(views)) < min(random)
    random = [qmc.discrepancy(chance.random((16, 3))) for _ in range(100)]
    for block in in_blocks(views, 16):
        assert qmc.discrepancy(unit(block)) < np.median(random)


def test_blocks_hold_everything_once_in_order():
    for count in (1, 3, 7):
        blocks = in_blocks(range(24), count)
        assert [i for block in blocks for i in block] == list(range(24))
        assert max(map(len, blocks)) - min(map(len, blocks)) <= 1
