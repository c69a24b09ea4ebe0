"""A glTF as trimesh reads it rightly: floats, triangles, one set of texture coordinates.

Compression, quantization and transforms of textures are worked out; what has no name gets one.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Iterator
from urllib.parse import unquote

import numpy as np
from jaxtyping import Float, Int, Num

from cnca.vehicle.mesh.gltf.accessors import as_numbers, read_accessor, view_bytes
from cnca.vehicle.mesh.gltf.compression import DRACO, unpack_primitive
from cnca.vehicle.mesh.gltf.container import BINARY, JSON, MAGIC, Container, Entry
from cnca.vehicle.mesh.gltf.looks import base_texture, plain_materials, uv_transform
from cnca.vehicle.mesh.names import guess_material

TRIANGLES, STRIP, FAN = 4, 5, 6
KEPT = {"POSITION": 3, "NORMAL": 3, "COLOR_0": 4}
"""Attributes that are handed on as they are, and their widths at most."""
UNNAMED = "unnamed"


def plain_glb(data: bytes, read: Callable[[str], bytes]) -> bytes:
    """The content of a ``.gltf`` or ``.glb`` as a plain GLB.

    ``read`` gives the bytes of a file that is named.  Raises MeshError for what it requires and we
    lack; ValueError, KeyError, IndexError, TypeError or OSError for what is damaged.
    """
    return _Plain(Container.of(data, read)).glb()


class _Plain:
    def __init__(self, file: Container) -> None:
        self.file = file
        self.blocks: list[bytes] = []
        self.size = 0
        """Bytes of all blocks."""
        self.accessors: list[Entry] = []
        self.views: list[Entry] = []
        self.materials = plain_materials(file.entries("materials"))
        self.by_mesh = _mesh_names_say_more(file)

    def glb(self) -> bytes:
        file = self.file
        meshes = [self._mesh(mesh) for mesh in file.entries("meshes")]
        content = {
            "asset": {"version": "2.0"},
            "meshes": meshes,
            "nodes": [
                _without(node, "camera", "skin", "weights") for node in file.entries("nodes")
            ],
            "materials": self.materials,
            "textures": [_texture(texture) for texture in file.entries("textures")],
            "images": [self._image(image) for image in file.entries("images")],
            **_scenes(file),
        }
        content |= {"accessors": self.accessors, "bufferViews": self.views}
        binary = b"".join(self.blocks)
        content["buffers"] = [{"byteLength": len(binary)}]
        text = json.dumps({key: value for key, value in content.items() if value != []}).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<II", len(text), JSON) + text
        chunks += struct.pack("<II", len(binary), BINARY) + binary
        return struct.pack("<III", MAGIC, 2, 12 + len(chunks)) + chunks

    def _mesh(self, mesh: Entry) -> Entry:
        parts = [self._primitive(part, mesh) for part in mesh["primitives"]]
        return {**_without(mesh, "weights"), "primitives": [part for part in parts if part]}

    def _primitive(self, part: Entry, mesh: Entry) -> Entry | None:
        """Points and lines are left out."""
        mode = part.get("mode", TRIANGLES)
        if mode not in (TRIANGLES, STRIP, FAN):
            return None
        attributes, corners = self._arrays(part)
        index = part.get("material")
        material = {} if index is None else self.file.entries("materials")[index]
        count = len(attributes["POSITION"])
        plain = {n: attributes[n][:, :w].astype(float) for n, w in KEPT.items() if n in attributes}
        if (uvs := _uvs(attributes, base_texture(material))) is not None:
            plain["TEXCOORD_0"] = uvs
        if corners is None:
            corners = np.arange(count)
        faces = _triangles(corners.astype(np.int64), mode)
        return {
            "attributes": {name: self._keep(values) for name, values in plain.items()},
            "indices": self._keep(faces.reshape(-1, 1)),
            "material": self._nameless(mesh) if index is None else index,
        }

    def _arrays(
        self, part: Entry
    ) -> tuple[dict[str, Num[np.ndarray, "count width"]], Int[np.ndarray, " corners"] | None]:
        file, packed = self.file, part.get("extensions", {}).get(DRACO)
        places = dict(part["attributes"])
        arrays: dict[str, Num[np.ndarray, "count width"]] = {}
        corners = None
        if packed:
            numbers = packed["attributes"]
            arrays, corners = unpack_primitive(view_bytes(file, packed["bufferView"]), numbers)
            for name in arrays:
                accessor = file.entries("accessors")[places.pop(name)]
                normalized = bool(accessor.get("normalized"))
                arrays[name] = as_numbers(arrays[name], normalized=normalized)
        elif "indices" in part:
            corners = read_accessor(file, part["indices"])[:, 0]
        wanted = {name: i for name, i in places.items() if name in KEPT or "TEXCOORD" in name}
        return arrays | {name: read_accessor(file, i) for name, i in wanted.items()}, corners

    def _nameless(self, mesh: Entry) -> int:
        """The number of a material for what has none: one for each mesh where names say more."""
        name = mesh.get("name", UNNAMED) if self.by_mesh else UNNAMED
        made = {"name": name, "extras": {"made": True}}
        if made not in self.materials:
            self.materials.append(made)
        return self.materials.index(made)

    def _keep(self, values: Num[np.ndarray, "count width"]) -> int:
        """The number of a new accessor."""
        whole = np.issubdtype(values.dtype, np.integer)
        data = values.astype("<u4" if whole else "<f4")
        kind = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}[data.shape[1]]
        accessor = {"componentType": 5125 if whole else 5126, "type": kind, "count": len(data)}
        self.accessors.append({"bufferView": self._store(data.tobytes()), **accessor})
        return len(self.accessors) - 1

    def _store(self, data: bytes) -> int:
        """The number of a new buffer view."""
        self.views.append({"buffer": 0, "byteOffset": self.size, "byteLength": len(data)})
        self.blocks.append(data + b"\0" * (-len(data) % 4))
        self.size += len(self.blocks[-1])
        return len(self.views) - 1

    def _image(self, image: Entry) -> Entry:
        if "uri" in image:
            uri = str(image["uri"])
            return {**image, "uri": uri if uri.startswith("data:") else unquote(uri)}
        return {**image, "bufferView": self._store(view_bytes(self.file, image["bufferView"]))}


def _uvs(
    attributes: dict[str, Num[np.ndarray, "count width"]], texture: Entry
) -> Float[np.ndarray, "count 2"] | None:
    """The set that the base color's picture is laid out in, as that is moved; else the first."""
    number, matrix = uv_transform(texture)
    sets = sorted(name for name in attributes if name.startswith("TEXCOORD_"))
    if not sets:
        return None
    name = f"TEXCOORD_{number}"
    uvs = attributes[name if name in sets else sets[0]][:, :2].astype(float)
    return uvs @ matrix[:, :2].T + matrix[:, 2]


def _triangles(corners: Int[np.ndarray, " corners"], mode: int) -> Int[np.ndarray, "faces 3"]:
    if mode == TRIANGLES:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    if len(corners) < 3:
        return np.zeros((0, 3), np.int64)
    middle = corners[1:-1]
    if mode == FAN:
        return np.column_stack([middle, corners[2:], np.full(len(middle), corners[0])])
    strip = np.column_stack([corners[:-2], middle, corners[2:]])
    strip[1::2] = strip[1::2][:, [0, 2, 1]]
    return strip


def _mesh_names_say_more(file: Container) -> bool:
    """Whether the names of meshes without a material say what some of them are."""
    return any(guess_material(name) != "trim" for name in _nameless_meshes(file))


def _nameless_meshes(file: Container) -> Iterator[str]:
    for mesh in file.entries("meshes"):
        if any("material" not in part for part in mesh["primitives"]):
            yield str(mesh.get("name", ""))


def _texture(texture: Entry) -> Entry:
    """Pictures in WebP stand in an extension."""
    webp = texture.get("extensions", {}).get("EXT_texture_webp", {})
    return {"source": texture["source"]} if "source" in texture else {**webp}


def _scenes(file: Container) -> Entry:
    """The file's scenes; where it has none, all nodes that no other one holds."""
    if file.entries("scenes"):
        return {"scenes": file.entries("scenes"), "scene": file.content.get("scene", 0)}
    nodes = file.entries("nodes")
    held = {child for node in nodes for child in node.get("children", [])}
    return {"scenes": [{"nodes": [i for i in range(len(nodes)) if i not in held]}], "scene": 0}


def _without(entry: Entry, *keys: str) -> Entry:
    return {key: value for key, value in entry.items() if key not in (*keys, "extensions")}
