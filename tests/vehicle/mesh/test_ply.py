"""PLY in every form: always the same two polygons, one of them concave."""

import struct

import numpy as np
import pytest
from PIL import Image

from cnca.core.errors import MeshError
from cnca.vehicle.mesh.load_mesh import load_vehicle
from cnca.vehicle.mesh.mesh_file import own_picture, read_meshes

CORNERS = [(0, 0), (4, 0), (4, 2), (2, 0.5), (0, 2), (5, 0), (5, 2)]
POLYGONS = [(0, 1, 2, 3, 4), (1, 5, 6, 2)]
AREA = 8 - 3 + 2
"""A rectangle with a notch, and one beside it."""
ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
LETTERS = {"int": "i", "uint": "I", "short": "h"}


def _ply(form="ascii", index="int", own_uvs=False, names=("s", "t")) -> bytes:
    lines = ["ply", f"format {form} 1.0", "comment TextureFile my paint.png"]
    lines += [f"element vertex {len(CORNERS)}", *(f"property float {n}" for n in "xyz")]
    lines += [f"property double {name}" for name in names]
    lines += [f"element face {len(POLYGONS)}", f"property list uchar {index} vertex_indices"]
    lines += ["property list uchar float texcoord"] if own_uvs else []
    head = "\n".join([*lines, "end_header", ""]).encode()
    uvs = [(x / 5, y / 2) for x, y in CORNERS]
    rows = [("3f", (x, y, 0)) + ("2d", uv) for (x, y), uv in zip(CORNERS, uvs, strict=True)]
    for polygon in POLYGONS:
        row = ("B", (len(polygon),), f"{len(polygon)}{LETTERS[index]}", polygon)
        flat = [value for corner in polygon for value in uvs[corner]]
        rows.append(row + (("B", (len(flat),), f"{len(flat)}f", flat) if own_uvs else ()))
    if form == "ascii":
        numbers = [[str(n) for part in row[1::2] for n in part] for row in rows]
        return head + "\n".join(" ".join(row) for row in numbers).encode()
    order = ORDERS[form]
    return head + b"".join(
        struct.pack(order + kind, *values)
        for row in rows
        for kind, values in zip(row[::2], row[1::2], strict=True)
    )


FORMS = {
    "text": _ply(),
    "windows": _ply().replace(b"\n", b"\r\n"),
    "little": _ply("binary_little_endian"),
    "big": _ply("binary_big_endian", "uint"),
    "short": _ply("binary_little_endian", "short").replace(b"vertex_indices", b"vertex_index"),
    "face coordinates": _ply("binary_little_endian", own_uvs=True, names=("a", "b")),
}


@pytest.mark.parametrize("form", FORMS)
def test_every_form_has_its_polygons(tmp_path, form):
    path = tmp_path / "a.ply"
    path.write_bytes(FORMS[form])
    Image.new("RGB", (2, 2)).save(tmp_path / "my paint.png")
    (mesh,) = read_meshes(path).geometry.values()
    assert mesh.area == pytest.approx(AREA)
    assert own_picture(mesh) is not None
    (part,) = load_vehicle(path, up="z", ground=False, recentre=False).parts
    np.testing.assert_allclose(part.uvs, part.vertices[:, :2] / (5, 2), atol=1e-6)


def test_colors_of_vertices_are_kept(tmp_path):
    """Where there are no coordinates: worlds show them."""
    path = tmp_path / "a.ply"
    head, rows = FORMS["text"].split(b"end_header\n")
    head = head.replace(b"double s", b"uchar red").replace(b"double t", b"uchar green")
    head = head.replace(b"float z", b"uchar blue\nproperty float z").replace(
        b"comment Tex", b"comment"
    )
    lines = rows.decode().split("\n")
    colored = [" ".join([*line.split()[:2], "200 0 10 20"]) for line in lines[: len(CORNERS)]]
    path.write_bytes(
        head + b"end_header\n" + "\n".join([*colored, *lines[len(CORNERS) :]]).encode()
    )
    (mesh,) = read_meshes(path).geometry.values()
    assert mesh.visual.vertex_colors[3, :3].tolist() == [10, 20, 200]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"vertex 7", b"vertex 9000000000", "ends before its last row"),
        (b"face 2", b"face 99999999999", "ends before its last row"),
        (b"vertex 7", b"vertex -1", "ends before its last row"),
        (b"\n5 0", b"\n-5 0", "ends before its last row"),
        (b"4 1 5 6 2", b"4 1 5 9 2", "a vertex that is not there"),
        (b"float y", b"float other", "no x, y and z"),
        (b"end_header", b"end", "has no header"),
    ],
)
def test_damaged_files_are_refused_in_one_line(tmp_path, old, new, message):
    path = tmp_path / "a.ply"
    path.write_bytes(FORMS["text"].replace(old, new))
    with pytest.raises(MeshError, match=f"cannot be read as PLY.*{message}"):
        read_meshes(path)
