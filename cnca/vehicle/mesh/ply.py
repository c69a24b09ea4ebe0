"""PLY files, whose polygons may have any number of corners.

Source: Greg Turk, "The PLY Polygon File Format", 1994.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import trimesh
from jaxtyping import Float, Num

from cnca.vehicle.mesh.mtl import made_material
from cnca.vehicle.mesh.polygons import triangles_of

KINDS = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8",
}  # fmt: skip
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
CORNERS = ("vertex_indices", "vertex_index")
COORDINATES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))
"""Names of a vertex's texture coordinates; a face's are its list ``texcoord``."""
PICTURE = "comment TextureFile "

Row = dict[str, np.ndarray]
Columns = dict[str, Num[np.ndarray, " rows"]]


@dataclass
class _Element:
    """A table of the file: ``count`` rows of numbers and lists of numbers."""

    name: str
    count: int
    properties: list[tuple[str, str, str]] = field(default_factory=list)
    """Name, kind of number, and kind of a list's length: empty where there is no list."""


@dataclass
class _Header:
    order: str
    """Order of the bytes; empty for text."""
    size: int
    elements: list[_Element]
    picture: str
    """Picture of the base color; empty where there is none."""


class _Source(Protocol):
    """The numbers of a file, one after the other; what is beyond the last raises ValueError."""

    def take(self, count: int, kind: str) -> Num[np.ndarray, " values"]: ...

    def columns(self, element: _Element) -> Columns: ...


def read_ply(data: bytes, read: Callable[[str], bytes]) -> trimesh.Trimesh:
    """All faces as triangles; ``read`` gives the bytes of a picture that is named.

    Raises ValueError, KeyError or IndexError for what is not a PLY file.
    """
    header = _header(data)
    body = data[header.size :]
    source: _Source = _Bytes(body, header.order) if header.order else _Text(body)
    columns: Columns = {}
    rows: list[Row] = []
    for element in header.elements:
        if element.name == "vertex":
            columns = source.columns(element)
        elif element.name == "face":
            rows = _rows(source, element)
        else:
            _rows(source, element)
    mesh = _mesh(columns, rows)
    if header.picture or mesh.metadata["uvs"] is not None:
        look = made_material({"picture": header.picture}, read)
        mesh.visual = trimesh.visual.TextureVisuals(uv=mesh.metadata["uvs"], material=look)
    elif (colors := _joined(columns, "red", "green", "blue")) is not None:
        mesh.visual = trimesh.visual.ColorVisuals(vertex_colors=colors.astype(np.uint8))
    return mesh


def _header(data: bytes) -> _Header:
    end = data.find(b"end_header")
    if not data.startswith(b"ply") or end < 0:
        raise ValueError("has no header")
    size = end + len(b"end_header")
    size += 2 if data[size : size + 2] == b"\r\n" else 1
    header = _Header("", size, [], "")
    for line in data[:end].decode("latin-1").replace("\r", "\n").split("\n"):
        words = line.split()
        key = words[0] if words else ""
        if key == "format":
            header.order = ORDERS[words[1]]
        elif key == "element":
            header.elements.append(_Element(words[1], int(words[2])))
        elif key == "property":
            name, kind = words[-1], KINDS[words[-2]]
            length = KINDS[words[2]] if words[1] == "list" else ""
            header.elements[-1].properties.append((name, kind, length))
        elif line.startswith(PICTURE):
            header.picture = line.removeprefix(PICTURE).strip()
    return header


def _rows(source: _Source, element: _Element) -> list[Row]:
    return [
        {
            name: source.take(int(source.take(1, length)[0]) if length else 1, kind)
            for name, kind, length in element.properties
        }
        for _ in range(element.count if element.properties else 0)
    ]


@dataclass
class _Text:
    body: bytes

    def __post_init__(self) -> None:
        self.numbers = np.array(self.body.split(), float)
        self.at = 0

    def take(self, count: int, kind: str) -> Num[np.ndarray, " values"]:
        values = self.numbers[self.at : self.at + count]
        if count < 0 or len(values) < count:
            raise ValueError("ends before its last row")
        self.at += count
        return values

    def columns(self, element: _Element) -> Columns:
        names = _names(element)
        block = self.take(element.count * len(names), "").reshape(-1, len(names))
        return dict(zip(names, block.T, strict=True))


@dataclass
class _Bytes:
    body: bytes
    order: str
    at: int = 0

    def take(self, count: int, kind: str) -> Num[np.ndarray, " values"]:
        return self._take(count, np.dtype(self.order + kind))

    def columns(self, element: _Element) -> Columns:
        names = _names(element)
        kinds = [self.order + kind for _, kind, _ in element.properties]
        block = self._take(element.count, np.dtype(list(zip(names, kinds, strict=True))))
        return {name: block[name] for name in names}

    def _take(self, count: int, kind: np.dtype[np.generic]) -> np.ndarray:
        if count < 0 or self.at + count * kind.itemsize > len(self.body):
            raise ValueError("ends before its last row")
        values = np.frombuffer(self.body, kind, count, self.at) if count else np.zeros(0, kind)
        self.at += count * kind.itemsize
        return values


def _names(element: _Element) -> list[str]:
    if not element.properties or any(length for *_, length in element.properties):
        raise ValueError(f"a {element.name} is made of numbers")
    return [name for name, *_ in element.properties]


def _mesh(columns: Columns, rows: Sequence[Row]) -> trimesh.Trimesh:
    """With UVs in its metadata; where faces have their own, each corner is a vertex."""
    vertices, normals = (
        _joined(columns, *names) for names in (("x", "y", "z"), ("nx", "ny", "nz"))
    )
    if vertices is None:
        raise ValueError("its vertices have no x, y and z")
    faces = [next(row[name] for name in CORNERS if name in row) for row in rows]
    sizes = np.array([len(face) for face in faces], int)
    corners = np.concatenate([np.zeros(0), *faces]).astype(np.int64)
    if len(corners) and not 0 <= corners.min() <= corners.max() < len(vertices):
        raise ValueError("a face names a vertex that is not there")
    triangles = triangles_of(sizes, vertices[corners])
    uvs = next((uv for names in COORDINATES if (uv := _joined(columns, *names)) is not None), None)
    own = [row.get("texcoord", np.zeros(0)) for row in rows]
    if faces and all(len(uv) == 2 * size for uv, size in zip(own, sizes, strict=True)):
        uvs = np.concatenate(own).reshape(-1, 2).astype(float)
        vertices, corners = vertices[corners], np.arange(len(corners))
        normals = None
    mesh = trimesh.Trimesh(vertices, corners[triangles], vertex_normals=normals, process=False)
    mesh.metadata["uvs"] = uvs
    return mesh


def _joined(columns: Columns, *names: str) -> Float[np.ndarray, "rows width"] | None:
    """The columns of these names side by side; None where one is missing."""
    if not all(name in columns for name in names):
        return None
    return np.column_stack([columns[name] for name in names]).astype(float)
