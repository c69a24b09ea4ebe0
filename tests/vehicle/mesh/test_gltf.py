"""glTF in every form that exporters give it: always the same square."""

import base64
import json
import struct
import sys
from pathlib import Path

import numpy as np
import pytest

from cnca.core.errors import MeshError
from cnca.vehicle.mesh.gltf.looks import uv_transform
from cnca.vehicle.mesh.mesh_file import read_meshes

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
UVS = CORNERS[:, :2]
"""v downwards, as glTF has it."""
FACES = np.array([0, 1, 2, 0, 2, 3])
KINDS = {"f4": 5126, "u1": 5121, "u2": 5123, "u4": 5125, "i1": 5120, "i2": 5122}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3"}


class Maker:
    """A glTF by hand, after the specification."""

    def __init__(self):
        self.data = b""
        self.content = {"asset": {"version": "2.0"}, "accessors": [], "bufferViews": []}
        self.content |= {"scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}]}

    def view(self, values, **more):
        at = len(self.data)
        self.data += values.tobytes() + b"\0" * (-values.nbytes % 4)
        self.content["bufferViews"].append(
            {"buffer": 0, "byteOffset": at, "byteLength": values.nbytes, **more}
        )
        return len(self.content["bufferViews"]) - 1

    def accessor(self, values, kind="f4", **more):
        values = np.asarray(values).astype("<" + kind)
        width = values.shape[1] if values.ndim == 2 else 1
        view = {"bufferView": self.view(values)} if "sparse" not in more else {}
        self.content["accessors"].append(
            {"componentType": KINDS[kind], "count": len(values), "type": TYPES[width]} | view | more
        )
        return len(self.content["accessors"]) - 1

    def primitive(self, position=None, uv=None, faces=FACES, material=None, **more):
        position = self.accessor(CORNERS) if position is None else position
        uv = self.accessor(UVS) if uv is None else uv
        attributes = {"POSITION": position, "TEXCOORD_0": uv, **more.pop("attributes", {})}
        indices = {} if faces is None else {"indices": self.accessor(faces, "u2")}
        named = {} if material is None else {"material": material}
        self.content.setdefault("meshes", [{"primitives": []}])
        part = {"attributes": attributes, **indices, **named, **more}
        self.content["meshes"][0]["primitives"].append(part)
        return self

    def write(self, folder: Path, name="a.gltf", uri=None) -> Path:
        buffer = {"byteLength": len(self.data)}
        if name.endswith(".glb"):
            self.content["buffers"] = [buffer]
            text = json.dumps(self.content).encode()
            text += b" " * (-len(text) % 4)
            body = struct.pack("<II", len(text), 0x4E4F534A) + text
            body += struct.pack("<II", len(self.data), 0x004E4942) + self.data
            data = struct.pack("<III", 0x46546C67, 2, 12 + len(body)) + body
            (folder / name).write_bytes(data)
            return folder / name
        coded = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
        self.content["buffers"] = [{**buffer, "uri": uri or coded}]
        (folder / name).write_text(json.dumps(self.content))
        return folder / name


def _read(path):
    (mesh,) = read_meshes(path).geometry.values()
    return mesh


def _is_the_square(mesh, uvs=UVS, atol=1e-6):
    assert mesh.area == pytest.approx(1, abs=1e-3)
    up = uvs * (1, -1) + (0, 1)
    np.testing.assert_allclose(mesh.vertices, CORNERS, atol=atol)
    np.testing.assert_allclose(mesh.visual.uv, up, atol=atol)


def _normalized(kind):
    most = np.iinfo(kind).max

    def make(maker):
        uv = maker.accessor(np.rint(UVS * most), kind, normalized=True)
        position = maker.accessor(np.rint(CORNERS * most), kind, normalized=True)
        return maker.primitive(position, uv)

    return make


def _sparse(maker):
    """Zeros of which two are moved."""
    at = maker.view(np.array([1, 2, 3], "<u2"))
    new = maker.view(CORNERS[1:].astype("<f4"))
    sparse = {"count": 3, "indices": {"bufferView": at, "componentType": 5123}}
    position = maker.accessor(CORNERS, sparse=sparse | {"values": {"bufferView": new}})
    return maker.primitive(position)


def _interleaved(maker):
    both = np.column_stack([CORNERS, UVS]).astype("<f4")
    view = maker.view(both, byteStride=20)
    numbers = []
    for start, width in ((0, 3), (12, 2)):
        numbers.append(maker.accessor(CORNERS[:, :width]))
        maker.content["accessors"][-1] |= {"bufferView": view, "byteOffset": start}
    return maker.primitive(*numbers)


FORMS = {
    "floats": lambda maker: maker.primitive(),
    **{f"normalized_{kind}": _normalized(kind) for kind in ("u1", "u2", "i1", "i2")},
    "whole_numbers": lambda maker: maker.primitive(maker.accessor(CORNERS, "i2")),
    "sparse": _sparse,
    "interleaved": _interleaved,
    "strip": lambda maker: maker.primitive(faces=[0, 1, 3, 2], mode=5),
    "fan": lambda maker: maker.primitive(faces=[0, 1, 2, 3], mode=6),
    "no_scene": lambda maker: maker.primitive(),
}


@pytest.mark.parametrize("name", ["a.gltf", "a.glb"])
@pytest.mark.parametrize("form", FORMS)
def test_every_form_is_the_same_square(tmp_path, form, name):
    maker = FORMS[form](Maker())
    if form == "no_scene":
        maker.content.pop("scenes")
    _is_the_square(_read(maker.write(tmp_path, name)))


def test_triangles_without_indices(tmp_path):
    maker = Maker()
    position, uv = maker.accessor(CORNERS[FACES]), maker.accessor(UVS[FACES])
    mesh = _read(maker.primitive(position, uv, faces=None).write(tmp_path))
    assert mesh.area == pytest.approx(1)


def test_percent_encoded_names_of_files(tmp_path):
    maker = Maker().primitive()
    (tmp_path / "my größe.bin").write_bytes(maker.data)
    _is_the_square(_read(maker.write(tmp_path, uri="my%20gr%C3%B6%C3%9Fe.bin")))


def test_the_picture_s_own_set_of_coordinates_is_read_and_moved(tmp_path):
    """KHR_texture_transform turns (1, 0) by +90° into (0, 1) after scaling, then moves it."""
    maker = Maker()
    second = maker.accessor(UVS * 0.5)
    moved = {"offset": [0.25, 0.5], "rotation": np.pi / 2, "scale": [0.5, 0.25], "texCoord": 1}
    texture = {"index": 0, "texCoord": 0, "extensions": {"KHR_texture_transform": moved}}
    maker.content["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": texture}}]
    maker.content["textures"] = [{}]
    maker.primitive(material=0, attributes={"TEXCOORD_1": second})
    expected = np.array([[0, 0], [0, 0.25], [-0.125, 0.25], [-0.125, 0]]) + (0.25, 0.5)
    _is_the_square(_read(maker.write(tmp_path)), expected)
    assert uv_transform({"texCoord": 2})[0] == 2


def test_materials_without_a_name_stay_apart_and_coordinates_need_none(tmp_path):
    maker = Maker()
    maker.content["materials"] = [{}, {}]
    for material in (0, 1, None):
        maker.primitive(material=material)
    scene = read_meshes(maker.write(tmp_path))
    names = {mesh.visual.material.name for mesh in scene.geometry.values()}
    assert names == {"material_0", "material_1", "unnamed"}
    for mesh in scene.geometry.values():
        _is_the_square(mesh)


def test_what_a_file_requires_and_we_lack_is_named(tmp_path):
    maker = Maker().primitive()
    maker.content["extensionsRequired"] = ["KHR_texture_basisu", "KHR_materials_sheen"]
    with pytest.raises(MeshError, match=r"a\.gltf: requires KHR_texture_basisu, which is not"):
        _read(maker.write(tmp_path))


def test_what_draco_packed_is_unpacked(tmp_path):
    draco = pytest.importorskip("DracoPy")
    packed = draco.encode(CORNERS.astype(np.float32), FACES.reshape(-1, 3), tex_coord=UVS)
    numbers = {one["attribute_type"]: one["unique_id"] for one in draco.decode(packed).attributes}
    maker = Maker()
    view = maker.view(np.frombuffer(packed, np.uint8))
    extension = {"bufferView": view, "attributes": {"POSITION": numbers[0], "TEXCOORD_0": numbers[3]}}  # fmt: skip  # noqa: E501
    maker.primitive(extensions={"KHR_draco_mesh_compression": extension})
    for accessor in maker.content["accessors"]:
        accessor.pop("bufferView")
    mesh = _read(maker.write(tmp_path))
    assert mesh.area == pytest.approx(1, abs=1e-3)
    np.testing.assert_allclose(mesh.visual.uv, mesh.vertices[:, :2] * (1, -1) + (0, 1), atol=1e-3)


@pytest.mark.parametrize("extension", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
def test_what_meshopt_packed_is_unpacked(tmp_path, extension):
    meshopt = pytest.importorskip("meshopt")
    maker = Maker()
    packed = meshopt.encode_gltf_buffer(CORNERS.astype("<f4"), "ATTRIBUTES")
    maker.primitive()
    at = len(maker.data)
    maker.data += packed
    said = {"buffer": 0, "byteOffset": at, "byteLength": len(packed), "byteStride": 12, "count": 4}
    view = maker.content["bufferViews"][0]
    view["extensions"] = {extension: said | {"mode": "ATTRIBUTES"}}
    view["byteOffset"] = 0
    maker.content["extensionsRequired"] = [extension]
    _is_the_square(_read(maker.write(tmp_path)))


@pytest.mark.parametrize("module", ["DracoPy", "meshopt"])
def test_without_the_package_compression_is_refused_by_name(tmp_path, module, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    maker = Maker().primitive()
    if module == "meshopt":
        extension = {
            "buffer": 0,
            "byteLength": 4,
            "byteStride": 12,
            "count": 4,
            "mode": "TRIANGLES",
        }
        maker.content["bufferViews"][0]["extensions"] = {"EXT_meshopt_compression": extension}
    else:
        extension = {"bufferView": 0, "attributes": {"POSITION": 0}}
        part = maker.content["meshes"][0]["primitives"][0]
        part["extensions"] = {"KHR_draco_mesh_compression": extension}
    with pytest.raises(MeshError, match=f"compression: is read with the package {module}"):
        _read(maker.write(tmp_path))


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: content["accessors"][0].update(count=5),
        lambda content: content["accessors"][0].update(count=10**12),
        lambda content: content["bufferViews"][0].update(byteLength=10**6),
        lambda content: content["accessors"][0].update(bufferView=99),
        lambda content: content["accessors"][0].update(componentType=1),
        lambda content: content.update(accessors={}),
        lambda content: content["meshes"][0]["primitives"][0]["attributes"].pop("POSITION"),
    ],
)
def test_damaged_files_are_refused_in_one_line(tmp_path, damage):
    maker = Maker().primitive()
    damage(maker.content)
    with pytest.raises(MeshError, match=r"a\.gltf: (cannot be read|holds no)"):
        _read(maker.write(tmp_path))
