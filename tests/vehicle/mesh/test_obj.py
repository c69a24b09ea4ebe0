"""OBJ and MTL as people write them."""

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cnca.core.errors import MeshError
from cnca.vehicle.mesh.companions import mesh_companions
from cnca.vehicle.mesh.load_mesh import load_vehicle
from cnca.vehicle.mesh.mesh_file import material_name, read_meshes
from cnca.vehicle.mesh.mtl import picture_name

SQUARE = """v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl paint
f 1/1 2/2 3/3 4/4
"""


def _write(folder: Path, text: str, encoding: str = "utf-8") -> Path:
    path = folder / "a.obj"
    path.write_bytes(text.encode(encoding))
    return path


def _area(path: Path) -> float:
    return sum(mesh.area for mesh in read_meshes(path).geometry.values())


SPELLINGS = {
    "tabs": SQUARE.replace(" ", "\t"),
    "crlf": SQUARE.replace("\n", "\r\n"),
    "cr": SQUARE.replace("\n", "\r"),
    "mark": "\ufeff" + SQUARE,
    "blanks": SQUARE.replace(" ", "   ").replace("\n", "  \n\n"),
    "continued": SQUARE.replace("3/3", "\\\n3/3"),
    "comments": SQUARE.replace("v 1 0 0", "v 1 0 0 # right").replace("4/4", "4/4 # last"),
    "negative": SQUARE.replace("1/1 2/2 3/3 4/4", "-4/-4 -3/-3 -2/-2 -1/-1"),
    "colors": SQUARE.replace("v 1 0 0", "v 1 0 0 0.5 0.5 0.5"),
    "triangles": SQUARE.replace("f 1/1 2/2 3/3 4/4", "f 1/1 2/2 3/3\nf 1/1 3/3 4/4"),
    "capitals": SQUARE.upper(),
    "commented names": SQUARE.replace("usemtl paint", "usemtl paint # red"),
    "lines": SQUARE + "l 1 2\np 1\ns off\n",
}


@pytest.mark.parametrize("name", SPELLINGS)
def test_every_spelling_is_the_same_square(tmp_path, name):
    path = _write(tmp_path, SPELLINGS[name])
    assert _area(path) == pytest.approx(1)
    assert {material_name(m).lower() for m in read_meshes(path).geometry.values()} == {"paint"}
    (part,) = load_vehicle(path, up="z", ground=False, recentre=False).parts
    np.testing.assert_allclose(part.uvs, part.vertices[:, :2], atol=1e-9)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-8-sig"])
def test_encodings(tmp_path, encoding):
    path = tmp_path / "a.obj"
    path.write_bytes(SQUARE.replace("paint", "Lack grün").encode(encoding))
    (mesh,) = read_meshes(path).geometry.values()
    assert mesh.visual.material.name == "Lack grün"


@pytest.mark.parametrize(
    ("encoding", "names"),
    [("gbk", "车身 车窗"), ("latin-1", "Größe Maße"), ("shift_jis", "車体 車窓")],
)
def test_names_in_other_encodings_are_not_merged(tmp_path, encoding, names):
    one, other = names.split()
    text = SQUARE.replace("paint", one) + f"usemtl {other}\nf 1 2 3\n"
    assert len(read_meshes(_write(tmp_path, text, encoding)).geometry) == 2


def test_concave_quads_and_polygons_have_their_own_area(tmp_path):
    """The arrow (0 0)(2 0)(2 2)(1.5 .5) from each corner; a U of eight corners."""
    arrow = ["v 0 0 0", "v 2 0 0", "v 2 2 0", "v 1.5 0.5 0"]
    for turn in range(4):
        face = " ".join(str((i + turn) % 4 + 1) for i in range(4))
        assert _area(_write(tmp_path, "\n".join([*arrow, f"f {face}"]))) == pytest.approx(1)
    u = [(0, 0), (3, 0), (3, 2), (2, 2), (2, 1), (1, 1), (1, 2), (0, 2)]
    vertices = [f"v {x} 0 {y}" for x, y in u]
    assert _area(_write(tmp_path, "\n".join([*vertices, "f 1 2 3 4 5 6 7 8"]))) == pytest.approx(5)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("f 1 2", "line 11: 'f 1 2': a face has three corners"),
        ("f 1 2 x", "line 11"),
        ("f 1 2 0", "names no vertex"),
        ("f 1 2 -9", "names what does not exist"),
        ("f 1 2 99", "beyond the last"),
        ("v 1,5 2 3", "line 11"),
        ("v 1 2", "needs 3 numbers"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(tmp_path, line, message):
    with pytest.raises(MeshError, match=message):
        read_meshes(_write(tmp_path, SQUARE + line + "\n"))


def test_pictures_of_materials_and_the_files_that_count(tmp_path):
    """A library and a picture with blanks in their names, options before the picture's."""
    Image.fromarray(np.full((2, 2, 3), 7, np.uint8)).save(tmp_path / "my body.png")
    (tmp_path / "my car.mtl").write_text("newmtl paint\n\tmap_Kd -s 1 1 1 -clamp on my body.png\n")
    path = _write(tmp_path, "mtllib my car.mtl\n" + SQUARE)
    (mesh,) = read_meshes(path).geometry.values()
    assert mesh.visual.material.image.size == (2, 2)
    assert [file.name for file in mesh_companions(path)] == ["my car.mtl", "my body.png"]


@pytest.mark.parametrize(
    ("rest", "name"),
    [
        ("a.png", "a.png"),
        ("-o 0.5 0.5 a b.png", "a b.png"),
        ("-s 2 a.png", "a.png"),
        ("-bm 1.0 -blendu on 1.png", "1.png"),
        (r"C:\cars\body.png", r"C:\cars\body.png"),
    ],
)
def test_options_before_a_picture(rest, name):
    assert picture_name(rest) == name


def test_a_library_that_is_no_text_or_a_picture_that_is_none_does_no_harm(tmp_path):
    (tmp_path / "a.mtl").write_bytes(b"newmtl paint\nKd 1 1\nmap_Kd a.png\nNs x\n\xff\xfe")
    (tmp_path / "a.png").write_bytes(io.BytesIO(b"no picture").getvalue())
    assert _area(_write(tmp_path, "mtllib a.mtl\n" + SQUARE)) == pytest.approx(1)
