"""Worlds from mesh files, good and bad."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from cnca.core.errors import MeshError
from cnca.world.mesh import load_world

SHARED = Path(__file__).parents[3] / "shared" / "data" / "worlds"
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("gone.obj", None, "no such file"),
        ("town.xml", "<scene/>", "not one of .obj, .ply, .stl, .gltf, .glb"),
        ("empty.obj", "", "export"),
        ("points.obj", "v 0 0 0\nv 1 0 0\n", "export"),
        ("nan.obj", TRIANGLE.replace("v 1 0 0", "v nan 0 0"), "NaN|zero area"),
        ("line.obj", TRIANGLE.replace("v 0 1 0", "v 2 0 0"), "zero area"),
        ("cut.glb", "glTF", "cannot be read as GLB"),
        ("cut.gltf", "{", "cannot be read as GLTF"),
        ("cut.ply", "ply\nformat ascii 1.0\nelement vertex 3\n", "cannot be read as PLY|triangles"),
    ],
)
def test_a_bad_file_is_one_line(tmp_path, name, content, message):
    file = tmp_path / "files" / name
    file.parent.mkdir()
    if content is not None:
        file.write_text(content)
    with pytest.raises(MeshError, match=message) as raised:
        load_world(file)
    assert "\n" not in str(raised.value)


def test_gltf_is_y_up_and_its_factors_are_linear(tmp_path):
    material = trimesh.visual.material.PBRMaterial(
        name="plaster",
        baseColorFactor=[0.25, 0.5, 1.0, 1.0],
        roughnessFactor=0.75,
        metallicFactor=0,
    )
    box = trimesh.creation.box([2, 6, 4])
    box.visual = trimesh.visual.TextureVisuals(uv=np.zeros((8, 2)), material=material)
    box.export(tmp_path / "box.glb")
    world = load_world(tmp_path / "box.glb")
    corners = np.concatenate([piece.vertices for piece in world.pieces])
    np.testing.assert_allclose(np.ptp(corners, axis=0), [2, 4, 6], atol=1e-6)
    (surface,) = world.surfaces.values()
    assert surface.base_color == pytest.approx((0.25, 0.5, 1.0), abs=1 / 255)
    assert (surface.roughness, surface.metallic) == (0.75, 0.0)


def test_a_mirrored_world_looks_outwards(tmp_path):
    scene = trimesh.Scene()
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    scene.add_geometry(trimesh.creation.box([2, 2, 2]), transform=mirror)
    scene.export(tmp_path / "box.glb")
    (piece,) = load_world(tmp_path / "box.glb").pieces
    a, b, c = np.moveaxis(piece.vertices[piece.faces], 1, 0)
    assert ((np.cross(b - a, c - a) * (a + b + c)).sum(axis=1) > 0).all()
    assert ((piece.normals * piece.vertices).sum(axis=1) > 0).all()


@pytest.mark.skipif(not SHARED.exists(), reason="needs ../shared/data/worlds")
@pytest.mark.parametrize(
    ("file", "scale"), [("mcity/meshes/mcity.obj", 0.254), ("kaykit_city/building_A.gltf", 1.0)]
)
def test_worlds_of_others_have_their_pictures(file, scale):
    world = load_world(SHARED / file, scale=scale)
    textured = [
        piece for piece in world.pieces if world.surfaces[piece.surface].texture is not None
    ]
    assert len(textured) > len(world.pieces) / 2
    assert all(piece.uvs is not None for piece in textured)
    assert len(world.source) >= 3
