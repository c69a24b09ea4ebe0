"""The paper's grid of views and weathers: complete, balanced when sampled, seeded."""

import numpy as np
import pytest

from cnca.core.errors import SceneError
from cnca.scene.cameras import orbit_of
from cnca.scene.paper_grid import PRESETS, balanced_cells, find_grid, grid_shots
from cnca.scene.schema import Scene

PAPER = PRESETS["paper"]


def test_the_grid_has_as_many_pictures_as_the_papers_test_set():
    views, weathers = grid_shots(Scene(), PAPER, 10**6, seed=0)
    assert len(weathers) == 16
    assert [len(own) for own in views] == [512] * 16
    assert len({(w.sun_altitude, w.fog.visibility if w.fog else None) for w in weathers}) == 16
    assert len(set(views[0])) == 512
    assert views[0] == views[15]


@pytest.mark.parametrize("count", [1, 7, 16, 96, 100, 1000, 4096, 5000, 8191])
def test_every_level_of_every_axis_comes_equally_often(count):
    cells = balanced_cells(PAPER.levels, count, seed=3)
    assert len(np.unique(cells, axis=0)) == len(cells) == count
    for axis, size in enumerate(PAPER.levels):
        times = np.bincount(cells[:, axis], minlength=size)
        assert times.max() - times.min() <= 1


def test_a_sample_follows_its_seed():
    one, same, other = (balanced_cells(PAPER.levels, 64, seed=s) for s in (0, 0, 1))
    assert (one == same).all()
    assert (one != other).any()


def test_axes_are_independent_of_each_other():
    """Over 200 samples every pair of elevation and distance comes as often as any other."""
    times = np.zeros((4, 4))
    for seed in range(200):
        cells = balanced_cells(PAPER.levels, 32, seed=seed)
        np.add.at(times, (cells[:, 1], cells[:, 3]), 1)
    # 400 each; a random 4 × 4 table with fixed margins varies by less than Poisson's σ of 20.
    assert np.abs(times - 400).max() < 4 * 20


def test_poses_are_those_of_the_grid_and_the_scene_gives_the_rest():
    scene = Scene.model_validate({"fog": {"visibility": 9, "height": 30}, "sun": {"azimuth": 7}})
    views, weathers = grid_shots(scene, PAPER, 64, seed=0)
    for own in views:
        for view in own:
            azimuth, elevation, distance = orbit_of(view)
            assert min(abs(azimuth - a) for a in (*PAPER.azimuths, 360)) < 1e-6
            assert min(abs(elevation - e) for e in PAPER.elevations) < 1e-6
            assert min(abs(distance - d) for d in PAPER.distances) < 1e-6
    assert {weather.sun_azimuth for weather in weathers} == {7}
    assert {weather.fog.height for weather in weathers if weather.fog} == {30}


def test_few_views_leave_weathers_out():
    views, weathers = grid_shots(Scene(), PAPER, 5, seed=0)
    assert len(views) == len(weathers) == 5
    assert all(len(own) == 1 for own in views)


def test_an_unknown_grid_is_named():
    with pytest.raises(SceneError, match="did you mean 'paper'"):
        find_grid("papr")
