"""What stands between a world's file and a vehicle in it."""

import pytest

from cnca.world.checkup import check_world
from cnca.world.mesh import load_world
from cnca.world.stand import ground_under
from tests.world.test_resolve import MTL, OBJ


@pytest.fixture
def town(tmp_path):
    folder = tmp_path / "alone"
    folder.mkdir()
    (folder / "town.obj").write_text(OBJ)
    (folder / "town.mtl").write_text(MTL)
    return folder / "town.obj"


def test_a_missing_picture_is_named(town):
    findings = check_world(town).findings
    assert any("road.png" in line and line.startswith("warning") for line in findings)


def test_a_place_is_free_and_on_the_ground(town):
    report = check_world(town)
    x, y = report.section["at"]
    assert report.usable
    assert -7.5 <= x <= 27.5
    assert -7.5 <= y <= 7.5
    assert ground_under(load_world(town), x, y) == 0


def test_a_world_in_millimetres_asks_for_a_scale(town):
    assert any("world.scale" in line for line in check_world(town, scale=0.001).findings)


def test_a_world_on_its_side_asks_for_its_axis(town):
    report = check_world(town, up="y")
    assert any("world.up" in line for line in report.findings)
    assert not report.usable
