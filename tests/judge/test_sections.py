"""Views by pose and weather."""

import math

import pytest

from cnca.judge.evaluate import Shots
from cnca.judge.sections import parameters, sections
from cnca.scene.cameras import orbit_of, orbit_view
from cnca.scene.weather import Fog, Weather


def view(azimuth, elevation=10.0, distance=7.0):
    return orbit_view(azimuth, elevation, distance, fov=45, width=8, height=8)


@pytest.mark.parametrize("pose", [(0.0, 0.0, 5.0), (123.4, 35.0, 12.5), (359.0, -5.0, 3.0)])
def test_orbit_of_inverts_orbit_view(pose):
    assert orbit_of(view(*pose)) == pytest.approx(pose)


SHOTS = Shots(
    [[view(0), view(350), view(44)], [view(90, 20), view(180, 30)]],
    [Weather(sun_altitude=20), Weather(sun_altitude=60, fog=Fog(60.0))],
    seed=0,
)


def test_parameters_follow_the_order_of_the_shots():
    table = parameters(SHOTS)
    assert [row["azimuth"] for row in table] == pytest.approx([0, 350, 44, 90, 180])
    assert [row["visibility"] for row in table] == [math.inf] * 3 + [60.0] * 2
    assert [row["sun"] for row in table] == [20] * 3 + [60] * 2


def test_levels_and_sectors():
    table = parameters(SHOTS)
    assert [(s.label, s.views) for s in sections(table, "azimuth")] == [
        ("0°", [0, 1]), ("45°", [2]), ("90°", [3]), ("180°", [4]),
    ]  # fmt: skip
    assert [(s.label, s.views) for s in sections(table, "visibility")] == [
        ("60", [3, 4]), ("clear", [0, 1, 2]),
    ]  # fmt: skip
    assert [s.label for s in sections(table, "elevation")] == ["10", "20", "30"]
    assert len(sections(table, "distance")) == 1


def test_many_values_are_cut_into_equal_parts():
    shots = Shots([[view(0, distance=5 + 0.1 * k) for k in range(12)]], [Weather()], seed=0)
    parts = sections(parameters(shots), "distance")
    assert [part.views for part in parts] == [[0, 1, 2], [3, 4, 5], [6, 7, 8], [9, 10, 11]]
    assert parts[0].label == "5–5.2"
