"""A scene's world: read, and moved around the vehicle."""

import numpy as np
import pytest
import yaml
from PIL import Image

from cnca.build import build_worlds
from cnca.core.errors import MeshError, SceneError
from cnca.scene.cameras import Spot
from cnca.scene.load_scene import load_scene

OBJ = """mtllib town.mtl
v -10 -10 0
v 30 -10 0
v 30 10 0
v -10 10 0
v 5 -1 4
v 7 -1 4
v 7 1 4
v 5 1 4
vt 0 0
vt 2 0
vt 2 2
vt 0 2
usemtl road
f 1/1 2/2 3/3 4/4
usemtl bridge
f 5 6 7 8
"""
MTL = "newmtl road\nKd 0.6 0.6 0.6\nmap_Kd C:\\art\\road.png\nnewmtl bridge\nKd 1 0 0\n"


def _built(scene):
    return build_worlds(scene)(Spot())


@pytest.fixture
def town(tmp_path):
    """A road with a bridge over it, 5 to 7 units ahead; its picture lies one folder off."""
    (tmp_path / "meshes").mkdir()
    (tmp_path / "pictures").mkdir()
    (tmp_path / "meshes" / "town.obj").write_text(OBJ)
    (tmp_path / "meshes" / "town.mtl").write_text(MTL)
    Image.new("RGB", (4, 2), (188, 0, 255)).save(tmp_path / "pictures" / "road.png")

    def scene(**world):
        section = {"file": "meshes/town.obj", **world}
        (tmp_path / "scene.yaml").write_text(yaml.safe_dump({"world": section}))
        return load_scene(tmp_path / "scene.yaml")

    return scene


def test_the_place_becomes_the_origin_in_metres(town):
    world = _built(town(scale=2, at=[12, 0, 8], heading=90))
    bridge = next(piece for piece in world.pieces if piece.surface == "bridge")
    low, high = bridge.vertices.min(axis=0), bridge.vertices.max(axis=0)
    # In the world's axes it spans x 10..14, y -2..2 at z 8; the vehicle there heads along +y.
    np.testing.assert_allclose([low, high], [[-2, -2, 0], [2, 2, 0]], atol=1e-12)


def test_a_place_without_a_height_is_on_the_lowest_ground_with_headroom(town):
    under = _built(town(at=[6, 0]))
    road = next(piece for piece in under.pieces if piece.surface == "road")
    np.testing.assert_allclose(road.vertices[:, 2], 0, atol=1e-12)


def test_a_place_off_the_ground_names_where_there_is_some(town):
    with pytest.raises(SceneError, match=r"no ground at \(50, 0\); it spans x -10.0 to 30.0"):
        _built(town(at=[50, 0]))


def test_a_vehicle_inside_a_wall_is_an_error(town, tmp_path):
    wall = "usemtl bridge\nv 20 -9 0\nv 20 9 0\nv 20 9 5\nv 20 -9 5\nf 9 10 11 12\n"
    with (tmp_path / "meshes" / "town.obj").open("a") as file:
        file.write(wall)
    with pytest.raises(SceneError, match=r"stands inside the vehicle at \(20.5, 0\); move it"):
        _built(town(at=[20.5, 0, 0]))
    _built(town(at=[24, 0, 0]))


def test_a_picture_is_found_where_it_lies_and_stands_for_the_color(town):
    surface = _built(town()).surfaces["road"]
    assert surface.base_color == (1, 1, 1)
    assert surface.texture.shape == (2, 4, 3)
    assert surface.texture[0, 0].tolist() == [188, 0, 255]


def test_colors_of_an_mtl_file_are_srgb(town):
    assert _built(town()).surfaces["bridge"].base_color == pytest.approx((1, 0, 0))


def test_a_name_alone_is_short_for_a_section(tmp_path):
    (tmp_path / "scene.yaml").write_text("world: town.obj\n")
    assert load_scene(tmp_path / "scene.yaml").world.file == "town.obj"


def test_an_unknown_builtin_world_is_an_error(tmp_path):
    (tmp_path / "scene.yaml").write_text("world: builtin:nowhere\n")
    with pytest.raises(MeshError, match="no such built-in world"):
        _built(load_scene(tmp_path / "scene.yaml"))


def test_an_unknown_key_of_a_world_names_the_nearest(tmp_path):
    (tmp_path / "scene.yaml").write_text("world: {file: town.obj, headin: 3}\n")
    with pytest.raises(SceneError, match="world.headin: unknown key; did you mean 'heading'"):
        load_scene(tmp_path / "scene.yaml")
