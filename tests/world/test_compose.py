"""Worlds put together of several files."""

import numpy as np
import pytest

from cnca.scene.schema import WorldSection
from cnca.world.model import Place
from cnca.world.resolve import resolve_world
from tests.world.test_resolve import MTL, OBJ


@pytest.fixture
def tile(tmp_path):
    (tmp_path / "town.obj").write_text(OBJ)
    (tmp_path / "town.mtl").write_text(MTL)
    return tmp_path


def section(*parts) -> WorldSection:
    return WorldSection.model_validate({"file": "town.obj", "at": [0, 0], "parts": list(parts)})


def test_parts_stand_where_they_are_put_and_share_surfaces(tile):
    alone = resolve_world(section(), tile)
    part = {"file": "town.obj", "at": [100, 50], "heading": 90}
    both = resolve_world(section(part), tile)
    assert len(both.pieces) == 2 * len(alone.pieces)
    assert len(both.surfaces) == len(alone.surfaces)
    own, other = (p.vertices for p in (both.pieces[0], both.pieces[len(alone.pieces)]))
    turned = np.stack([100 - own[:, 1], 50 + own[:, 0], own[:, 2]], axis=1)
    np.testing.assert_allclose(other, turned, atol=1e-9)


def test_the_vehicle_may_stand_on_a_part(tile):
    part = {"file": "town.obj", "at": [100, 50]}
    world = resolve_world(
        WorldSection.model_validate({"file": "town.obj", "at": [100, 50], "parts": [part]}), tile
    )
    assert world.places[0] == Place(100, 50)
