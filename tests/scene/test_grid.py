"""The grid of a data set."""

from __future__ import annotations

from collections import Counter

import pytest

from cnca.scene.grid import COLOURS, SHARING, Grid
from cnca.scene.schema import Scene

CLEAR = Grid(Scene())
FOGGY = Grid(Scene.model_validate({"variation": {"visibility": [40, 400]}}))


@pytest.mark.parametrize("grid", [CLEAR, FOGGY], ids=["clear", "fog"])
def test_sixteen_weathers_and_every_cell_once(grid):
    assert len(set(grid.weathers)) == 16
    assert len({s.weather.sun_altitude for s in map(grid.__getitem__, range(100))}) == 4
    cells = {(s.view, s.weather, s.colour) for s in map(grid.__getitem__, range(len(grid)))}
    assert len(cells) == len(grid) == 24 * 4 * 3 * 16 * len(COLOURS)


def test_fog_densities_are_evenly_spread():
    visibilities = [w.fog.visibility for w in FOGGY.weathers]
    assert (min(visibilities), max(visibilities)) == pytest.approx((40, 400))
    extinctions = sorted(w.fog.extinction for w in FOGGY.weathers)[::4]
    steps = [b - a for a, b in zip(extinctions, extinctions[1:], strict=False)]
    assert steps == pytest.approx([steps[0]] * 3)


@pytest.mark.parametrize("start", [0, 5000])
def test_every_stretch_is_evenly_spread(start):
    """Of 1600 pictures each weather, colour and azimuth gets about its share."""
    settings = [CLEAR[k] for k in range(start, start + 1600)]
    for found, kinds in (
        (Counter(s.weather for s in settings), 16),
        (Counter(s.colour for s in settings), len(COLOURS)),
        (Counter(s.azimuth for s in settings), 24),
    ):
        assert len(found) == kinds
        assert max(found.values()) <= 1.5 * 1600 / kinds


def test_neighbours_share_pose_and_weather_but_not_the_colour():
    settings = [CLEAR[k] for k in range(5 * SHARING)]
    for first in range(0, len(settings), SHARING):
        group = settings[first : first + SHARING]
        assert len({(s.view, s.weather) for s in group}) == 1
        assert len({s.colour for s in group}) == SHARING
    assert len({s.view for s in settings}) == 5


def test_pictures_beyond_the_grid_do_not_exist():
    with pytest.raises(IndexError, match="the grid has"):
        CLEAR[len(CLEAR)]
