"""Vehicles as OBJ files, in our axes: +x front, +z up, metres."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cnca.core.errors import MeshError
from cnca.core.files import replacing
from cnca.vehicle.model import Part, Vehicle


def write_obj(path: str | Path, vehicle: Vehicle) -> None:
    """Write all parts with normals, texture coordinates and material names; whole or not at all.

    Scenes read the file back with ``up: z``.  Raises MeshError for an ending other than .obj.
    """
    path = Path(path)
    if path.suffix.lower() != ".obj":
        raise MeshError(f"{path}: vehicles are written as OBJ; end the name with .obj")
    lines, vertex, texel = ["# +x front, +z up, metres"], 1, 1
    for part in vehicle.parts:
        lines += _part_lines(part, vertex, texel)
        vertex += len(part.vertices)
        texel += 0 if part.uvs is None else len(part.uvs)
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _part_lines(part: Part, vertex: int, texel: int) -> Iterator[str]:
    """``vertex`` and ``texel`` are the numbers of the part's first ones."""
    yield f"o {part.name}"
    yield f"usemtl {part.material}"
    yield from _rows("v", part.vertices, 9)
    yield from _rows("vn", part.normals, 5)
    if part.uvs is None:
        for face in part.faces + vertex:
            yield "f " + " ".join(f"{i}//{i}" for i in face)
        return
    yield from _rows("vt", part.uvs, 8)
    for face in part.faces:
        yield "f " + " ".join(f"{i + vertex}/{i + texel}/{i + vertex}" for i in face)


def _rows(kind: str, values: np.ndarray, digits: int) -> Iterator[str]:
    for row in values:
        yield kind + "".join(f" {value:.{digits}f}" for value in row)
