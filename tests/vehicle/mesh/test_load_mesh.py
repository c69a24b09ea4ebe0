"""Vehicles from files: axes, texture coordinates, materials, and what is refused."""

import base64
import json
from pathlib import Path

import numpy as np
import pytest

from cnca.core.errors import MeshError
from cnca.vehicle.mesh.load_mesh import load_vehicle, resolve_vehicle

SHARED = Path(__file__).parents[3] / "../shared"
ETRON = (SHARED / "data/etron/pytorch3d_Etron.obj").resolve()
ASAM = (SHARED / "data/vehicles/asam_vehicle/vehicle_example.gltf").resolve()

# A wedge, y up, whose nose (vertex 0) points along +x: 4 m long, 2 m wide, 1 m high.
VERTICES = np.array([[2, 0.5, 0], [-2, 0.5, -1], [-2, 0.5, 1], [-2, 1.5, 0]], float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
UVS = np.array([[0.5, 0.25], [0, 0], [1, 0], [0.5, 1]], float)
"""v upwards: the wedge's top is at v = 1."""


def _write_obj(path, vertices=VERTICES, faces=FACES, uvs=UVS, header="", between=""):
    lines = [header] + [f"v {x} {y} {z}" for x, y, z in vertices]
    if uvs is not None:
        lines += [f"vt {u} {v}" for u, v in uvs]
    corner = "{0}/{0}" if uvs is not None else "{0}"
    drawn = ["f " + " ".join(corner.format(i + 1) for i in face) for face in faces]
    lines += [*drawn[:2], between, *drawn[2:]]
    path.write_text("\n".join(lines) + "\n")
    return path


def _write_ply(path):
    header = ["ply", "format ascii 1.0", f"element vertex {len(VERTICES)}"]
    header += [f"property float {name}" for name in ("x", "y", "z", "s", "t")]
    header += [f"element face {len(FACES)}", "property list uchar int vertex_indices", "end_header"]
    rows = [" ".join(map(str, (*p, *t))) for p, t in zip(VERTICES, UVS, strict=True)]
    rows += ["3 " + " ".join(map(str, face)) for face in FACES]
    path.write_text("\n".join(header + rows) + "\n")
    return path


def _write_gltf(path, node=None):
    """By hand after the glTF 2.0 specification, where v points downwards."""
    down = UVS * (1, -1) + (0, 1)
    blocks = [VERTICES.astype("<f4"), down.astype("<f4"), FACES.astype("<u2").ravel()]
    offsets = np.cumsum([0] + [block.nbytes for block in blocks]).tolist()
    data = b"".join(block.tobytes() for block in blocks)
    kinds = [("VEC3", 5126, len(VERTICES)), ("VEC2", 5126, len(UVS)), ("SCALAR", 5123, FACES.size)]
    path.write_text(
        json.dumps(
            {
                "asset": {"version": "2.0"},
                "scene": 0,
                "scenes": [{"nodes": [0]}],
                "nodes": [{"mesh": 0, "name": "wedge", **(node or {})}],
                "materials": [{"name": "Car_Paint"}],
                "meshes": [
                    {
                        "primitives": [
                            {
                                "attributes": {"POSITION": 0, "TEXCOORD_0": 1},
                                "indices": 2,
                                "material": 0,
                            }
                        ]
                    }
                ],
                "accessors": [
                    {
                        "bufferView": i,
                        "componentType": component,
                        "count": count,
                        "type": kind,
                        **({"min": [-2, 0.5, -1], "max": [2, 1.5, 1]} if i == 0 else {}),
                    }
                    for i, (kind, component, count) in enumerate(kinds)
                ],
                "bufferViews": [
                    {"buffer": 0, "byteOffset": offsets[i], "byteLength": blocks[i].nbytes}
                    for i in range(3)
                ],
                "buffers": [
                    {
                        "byteLength": len(data),
                        "uri": "data:application/octet-stream;base64,"
                        + base64.b64encode(data).decode(),
                    }
                ],
            }
        )
    )
    return path


def _signed_volume(part):
    """Positive if the triangles of a closed surface are counter-clockwise seen from outside."""
    a, b, c = (part.vertices[part.faces[:, i]] for i in range(3))
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


WRITERS = {"wedge.obj": _write_obj, "wedge.ply": _write_ply, "wedge.gltf": _write_gltf}


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_the_same_vehicle(tmp_path, name):
    (part,) = load_vehicle(WRITERS[name](tmp_path / name)).parts
    nose = part.vertices[:, 0].argmax()
    top = part.vertices[:, 2].argmax()
    right = part.vertices[:, 1].argmin()
    np.testing.assert_allclose(part.vertices[nose], (2, 0, 0), atol=1e-6)
    np.testing.assert_allclose(part.vertices[top], (-2, 0, 1), atol=1e-6)
    # y up and x forward put the file's +z on the right-hand side.
    np.testing.assert_allclose(part.vertices[right], (-2, -1, 0), atol=1e-6)
    np.testing.assert_allclose(part.uvs[top], (0.5, 1), atol=1e-6)
    np.testing.assert_allclose(part.uvs[right], (1, 0), atol=1e-6)
    assert part.material == "paint"
    assert _signed_volume(part) == pytest.approx(4 * 2 * 1 / 6, rel=1e-5)


@pytest.mark.parametrize(
    ("up", "front", "nose"),
    [("y", "+x", (2, 0)), ("y", "-x", (-2, 0)), ("y", "+z", (0, 2)), ("z", "+x", (2, 0.5))],
)
def test_axes_are_turned_without_mirroring(tmp_path, up, front, nose):
    path = _write_obj(tmp_path / "w.obj")
    (part,) = load_vehicle(path, up=up, front=front, recentre=False).parts
    tip = part.vertices[np.flatnonzero(np.isclose(part.uvs[:, 1], 0.25))[0]]
    np.testing.assert_allclose(tip[:2], nose, atol=1e-9)
    assert _signed_volume(part) > 0
    assert part.vertices[:, 2].min() == 0


def test_scale_is_metres_per_unit(tmp_path):
    path = _write_obj(tmp_path / "w.obj")
    (part,) = load_vehicle(path, scale=0.01, ground=False).parts
    np.testing.assert_allclose(np.ptp(part.vertices, axis=0), (0.04, 0.02, 0.01))
    assert part.vertices[:, 2].min() == pytest.approx(0.005)


def test_a_mirroring_node_does_not_turn_the_surface_inside_out(tmp_path):
    path = _write_gltf(tmp_path / "w.gltf", node={"scale": [1, 1, -1], "translation": [0, 3, 0]})
    (part,) = load_vehicle(path).parts
    assert _signed_volume(part) > 0
    assert part.vertices[:, 2].min() == 0


@pytest.mark.parametrize(("away", "moved"), [(0.5, 0.0), (12.0, 12.0), (-1400.0, -1400.0)])
def test_a_vehicle_away_from_the_origin_is_moved_onto_it(tmp_path, away, moved):
    """One whose axle is the origin is not."""
    path = _write_obj(tmp_path / "w.obj", vertices=VERTICES + (away, 0, 0))
    (part,) = load_vehicle(path).parts
    (kept,) = load_vehicle(path, recentre=False).parts
    assert part.vertices[:, 0].max() == pytest.approx(2 + away - moved)
    assert kept.vertices[:, 0].max() == pytest.approx(2 + away)


@pytest.mark.parametrize("name", WRITERS)
def test_missing_normals_are_made_outward(tmp_path, name):
    (part,) = load_vehicle(WRITERS[name](tmp_path / name)).parts
    np.testing.assert_allclose(np.linalg.norm(part.normals, axis=1), 1, atol=1e-6)
    outward = part.vertices - part.vertices.mean(axis=0)
    assert (np.einsum("ij,ij->i", outward, part.normals) > 0).all()


def test_normals_of_the_file_are_kept_and_turned(tmp_path):
    path = tmp_path / "w.obj"
    text = "v 0 0 0\nv 1 0 0\nv 0 0 -1\nvt 0 0\nvt 1 0\nvt 0 1\nvn 0.6 0.8 0\n"
    path.write_text(text + "f 1/1/1 2/2/1 3/3/1\n")
    (part,) = load_vehicle(path, scale=2).parts
    np.testing.assert_allclose(part.normals, [[0.6, 0, 0.8]] * 3, atol=1e-6)


def test_a_uv_seam_keeps_both_coordinates(tmp_path):
    path = tmp_path / "w.obj"
    corners = "v 0 0 0\nv 1 0 0\nv 1 0 -1\nv 0 0 -1\n"
    coordinates = "vt 0 0\nvt 0.4 0\nvt 0.4 0.4\nvt 0.6 0.6\nvt 1 1\nvt 0.6 1\n"
    path.write_text(corners + coordinates + "f 1/1 2/2 3/3\nf 1/4 3/5 4/6\n")
    (part,) = load_vehicle(path).parts
    by_face = part.uvs[part.faces]
    np.testing.assert_allclose(by_face[0], [[0, 0], [0.4, 0], [0.4, 0.4]])
    np.testing.assert_allclose(by_face[1], [[0.6, 0.6], [1, 1], [0.6, 1]])


def test_materials_are_told_by_name_without_the_mtl_file(tmp_path):
    header, between = "mtllib missing.mtl\nusemtl Paint_Red", "usemtl Rubber Black"
    path = _write_obj(tmp_path / "w.obj", header=header, between=between)
    assert sorted(part.material for part in load_vehicle(path).parts) == ["paint", "tyre"]
    chosen = load_vehicle(path, materials={"Rubber Black": "glass"})
    assert sorted(part.material for part in chosen.parts) == ["glass", "paint"]


def test_the_only_material_whose_name_says_nothing_is_the_body(tmp_path):
    path = _write_obj(tmp_path / "w.obj", header="usemtl Bus", between="usemtl Wheels_01")
    assert sorted(part.material for part in load_vehicle(path).parts) == ["paint", "tyre"]


def _with_materials(path):
    return _write_obj(path, header="usemtl Shell", between="usemtl Wood")


def _with_nan(path):
    return _write_obj(path, vertices=np.where(VERTICES == 2, np.nan, VERTICES))


def _rubbish(path):
    path.write_bytes(bytes(range(256)))


@pytest.mark.parametrize(
    ("name", "write", "message"),
    [
        ("w.obj", lambda path: None, "no such file"),
        ("w.objj", lambda path: path.touch(), r"did you mean '\.obj'"),
        ("w.obj", lambda path: path.write_text("v 0 0 0\n"), "no triangles|cannot be read"),
        ("w.obj", lambda path: _write_obj(path, uvs=None), "no texture coordinates"),
        ("w.obj", lambda path: _write_obj(path, uvs=UVS * 2), r"span \[0, 2\]"),
        ("w.obj", _with_nan, "NaN"),
        ("w.obj", _with_materials, "which material is paint.*Shell, Wood"),
        ("w.obj", lambda path: _write_obj(path, vertices=VERTICES * 0), "zero area"),
        ("w.ply", _rubbish, "cannot be read as PLY"),
        ("w.glb", _rubbish, "cannot be read as GLB"),
        ("w.gltf", _rubbish, "cannot be read as GLTF"),
        ("w.gltf", lambda path: path.write_text("{}"), "cannot be read as GLTF|no triangles"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path, name, write, message):
    write(tmp_path / name)
    with pytest.raises(MeshError, match=message) as caught:
        load_vehicle(tmp_path / name)
    assert str(tmp_path / name) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"up": "y", "front": "+y"}, "different axes"),
        ({"front": "x"}, "different axes"),
        ({"materials": {"Pant": "paint"}}, "no material 'Pant'; did you mean 'Paint'"),
        ({"materials": {"Paint": "pain"}}, "did you mean 'paint'"),
    ],
)
def test_bad_arguments_name_the_right_ones(tmp_path, arguments, message):
    path = _write_obj(tmp_path / "w.obj", header="usemtl Paint")
    with pytest.raises(MeshError, match=message):
        load_vehicle(path, **arguments)


def test_builtin_vehicles_are_found_by_name():
    assert resolve_vehicle("builtin:sedan").name == "builtin:sedan"
    with pytest.raises(MeshError, match="did you mean 'sedan'"):
        resolve_vehicle("builtin:sedn")


def test_paths_start_at_the_base_folder(tmp_path):
    _write_obj(tmp_path / "w.obj")
    assert resolve_vehicle("w.obj", tmp_path).name == "w"


@pytest.mark.skipif(not ETRON.exists(), reason="the E-Tron lies beside the checkout only")
def test_the_etron_drives_forward_on_the_ground():
    (part,) = load_vehicle(ETRON).parts
    assert part.faces.shape == (23_145, 3)
    np.testing.assert_allclose(np.ptp(part.vertices, axis=0), (4.86, 2.03, 1.65), atol=0.01)
    assert part.vertices[:, 2].min() == 0
    # The bonnet is in front: there the car is lower than at its tail.
    x, z = part.vertices[:, 0], part.vertices[:, 2]
    assert z[x > 1.5].max() < z[x < -1.5].max() - 0.3
    # Every triangle's winding agrees with its normals.
    corners = part.vertices[part.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("ij,ij->i", across, part.normals[part.faces].mean(axis=1)) > 0).all()


@pytest.mark.skipif(not ASAM.exists(), reason="the second vehicle lies beside the checkout only")
def test_the_second_vehicle_needs_and_gets_a_new_atlas():
    with pytest.raises(MeshError, match="'Body': texture coordinates span.*or set unwrap"):
        load_vehicle(ASAM)
    vehicle = load_vehicle(ASAM, unwrap=True)
    materials = {part.material for part in vehicle.parts}
    assert materials >= {"paint", "glass", "tyre", "metal", "light", "tail_light", "plate", "trim"}
    vertices = np.concatenate([part.vertices for part in vehicle.parts])
    np.testing.assert_allclose(np.ptp(vertices, axis=0), (3.85, 1.62, 1.30), atol=0.01)
    assert vertices[:, 2].min() == pytest.approx(0, abs=1e-6)
    # The front is at +x, or else the door named left would lie on the right.
    left = next(part for part in vehicle.parts if part.name == "Door_FL")
    assert left.vertices[:, 1].mean() > 0.5
