"""Wavefront OBJ files, with one surface for each material.

Source: Wavefront, "Object Files (.obj)", in the Advanced Visualizer manual, appendix B1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import trimesh
from jaxtyping import Float

from cnca.core.text import decode_names
from cnca.vehicle.mesh.mtl import material_library, materials_of
from cnca.vehicle.mesh.polygons import triangles_of

UNNAMED = "unnamed"
"""The material of faces before the first ``usemtl``."""
Names = list[str]


@dataclass
class _Faces:
    """The faces of one material, of any number of corners each."""

    sizes: list[int] = field(default_factory=list)
    corners: list[tuple[int, int, int]] = field(default_factory=list)
    """Indices of vertex, texture coordinate and normal; -1 where there is none."""
    groups: set[str] = field(default_factory=set)
    """Names of the objects and groups that they come from."""


@dataclass
class _Content:
    vertices: list[list[float]] = field(default_factory=list)
    uvs: list[list[float]] = field(default_factory=list)
    normals: list[list[float]] = field(default_factory=list)
    faces: dict[str, _Faces] = field(default_factory=dict)
    libraries: list[str] = field(default_factory=list)


def read_obj(data: bytes, name: str, read: Callable[[str], bytes]) -> trimesh.Scene:
    """All faces as triangles; a surface is named after its material, or object where alone.

    ``read`` gives the bytes of a file that is named; one that is missing (OSError) is done without.
    Raises ValueError with the number of a line that is not valid.
    """
    content = _parse(decode_names(data))
    materials: dict[str, trimesh.visual.material.SimpleMaterial] = {}
    for library in content.libraries:
        materials |= materials_of(library, read)
    vertices, uvs, normals = (
        np.array(rows, float).reshape(-1, width)
        for rows, width in ((content.vertices, 3), (content.uvs, 2), (content.normals, 3))
    )
    scene = trimesh.Scene()
    for material, faces in content.faces.items():
        mesh = _mesh(faces, vertices, uvs, normals)
        look = materials.get(material) or trimesh.visual.material.SimpleMaterial()
        look.name = material
        mesh.visual = trimesh.visual.TextureVisuals(uv=mesh.metadata.pop("uvs"), material=look)
        alone = len(content.faces) == 1
        called = min(faces.groups, default=name) if alone else material
        called = called if called != scene.graph.base_frame else f"{called}_"
        scene.add_geometry(mesh, node_name=called, geom_name=called)
    return scene


def _parse(text: str) -> _Content:
    content, group, material = _Content(), "", UNNAMED
    rows = {"v": (content.vertices, 3), "vt": (content.uvs, 2), "vn": (content.normals, 3)}
    for number, line in enumerate(text.replace("\\\n", " ").split("\n"), start=1):
        words = line.split()
        key = words[0].lower() if words else ""
        try:
            if key in rows:
                values, width = rows[key]
                values.append(_numbers(words, width))
            elif key == "f":
                faces = content.faces.setdefault(material, _Faces())
                corners = [_corner(word, content) for word in _words(words)]
                if len(corners) < 3:
                    raise ValueError("a face has three corners at least")
                faces.sizes.append(len(corners))
                faces.corners += corners
                faces.groups |= {group} if group else set()
        except (ValueError, IndexError, OverflowError) as error:
            raise ValueError(f"line {number}: {line.strip()[:40]!r}: {error}") from None
        rest = line.split(" #")[0].strip(" \t")[len(key) :].strip(" \t")
        if key == "usemtl":
            material = rest or UNNAMED
        elif key in ("o", "g"):
            group = rest
        elif key == "mtllib":
            content.libraries += material_library(rest)
    return content


def _words(words: Names) -> Names:
    """What follows the first word, without a comment."""
    comment = next((i for i, word in enumerate(words) if word.startswith("#")), len(words))
    return words[1:comment]


def _numbers(words: Names, width: int) -> list[float]:
    numbers = [float(word) for word in _words(words)[:width]]
    if len(numbers) < width:
        if words[0].lower() == "vt" and numbers:  # a texture of one dimension
            return [*numbers, 0.0]
        raise ValueError(f"needs {width} numbers")
    return numbers


def _corner(word: str, content: _Content) -> tuple[int, int, int]:
    """Indices into the lists; numbers in the file start at 1, or at -1 from the end."""
    parts = [*word.split("/"), "", ""]
    lists = (content.vertices, content.uvs, content.normals)
    places = []
    for part, values in zip(parts, lists, strict=False):
        place = int(part) if part else 0
        places.append(place - 1 if place >= 0 else len(values) + place)
        if place < 0 and places[-1] < 0:
            raise ValueError(f"'{word}' names what does not exist")
    if places[0] < 0:
        raise ValueError(f"'{word}' names no vertex")
    return places[0], places[1], places[2]


def _mesh(
    faces: _Faces,
    vertices: Float[np.ndarray, "vertices 3"],
    uvs: Float[np.ndarray, "uvs 2"],
    normals: Float[np.ndarray, "normals 3"],
) -> trimesh.Trimesh:
    """A vertex per combination of place, texture coordinate and normal; UVs in its metadata."""
    corners = np.array(faces.corners, np.int64)
    for column, values in enumerate((vertices, uvs, normals)):
        if corners[:, column].max() >= len(values):
            raise ValueError("a face names a vertex, texture coordinate or normal beyond the last")
    triangles = triangles_of(np.array(faces.sizes), vertices[corners[:, 0]])
    _, first, joined = np.unique(
        (corners[:, 0] * (len(uvs) + 1) + corners[:, 1] + 1) * (len(normals) + 1)
        + corners[:, 2]
        + 1,
        return_index=True,
        return_inverse=True,
    )
    v, t, n = corners[first].T
    given = None
    if (n >= 0).any():  # missing ones are made, as are those that are not unit vectors
        given = np.where(n[:, None] >= 0, normals[n], 0.0)
    mesh = trimesh.Trimesh(vertices[v], joined[triangles], vertex_normals=given, process=False)
    mesh.metadata["uvs"] = uvs[t] if (t >= 0).all() else None
    mesh.metadata["groups"] = sorted(faces.groups)
    return mesh
