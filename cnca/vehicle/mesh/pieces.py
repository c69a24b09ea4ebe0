"""A mesh file's pieces as they stand in it, faults and all: what a check looks at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float, Int
from PIL import Image

from cnca.core.errors import MeshError
from cnca.scene.schema import VehicleSection
from cnca.vehicle.mesh.load_mesh import BUILTIN, resolve_vehicle, to_our_axes
from cnca.vehicle.mesh.mesh_file import (
    file_uvs,
    given_normals,
    material_name,
    own_picture,
    read_meshes,
)
from cnca.vehicle.mesh.names import material_kinds
from cnca.vehicle.mesh.surface import face_crosses

OURS = {"up": "z", "front": "+x", "scale": 1.0}
"""The axes and units of built-in vehicles, as a scene's vehicle section says them."""


@dataclass(frozen=True)
class Piece:
    """One piece of a file, in its axes and units; nothing in it has been checked."""

    name: str
    material: str
    """The file's name of its material."""
    kind: str
    """Our material."""
    vertices: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]
    normals: Float[np.ndarray, "vertices 3"] | None
    uvs: Float[np.ndarray, "vertices 2"] | None
    groups: tuple[str, ...] = ()
    """Names of the file's objects that it was put together from, where that is known."""
    picture: Image.Image | None = None
    """The file's own picture of the base color."""

    @property
    def triangles(self) -> Float[np.ndarray, "faces 3 3"]:
        """The corners of each face."""
        return self.vertices[self.faces]

    @property
    def areas(self) -> Float[np.ndarray, " faces"]:
        """Area of each face, in squared units of the file; NaN where a corner is."""
        return np.linalg.norm(face_crosses(self.vertices, self.faces), axis=1) / 2


def read_pieces(section: VehicleSection, base: Path) -> list[Piece]:
    """The pieces of a vehicle's mesh, each with the material that the section gives it.

    Raises MeshError where the file is missing, unreadable or without triangles.
    """
    if section.mesh.startswith(BUILTIN):
        vehicle = resolve_vehicle(section.mesh)
        return [
            Piece(p.name, p.material, p.material, p.vertices, p.faces, p.normals, p.uvs)
            for p in vehicle.parts
        ]
    scene = read_meshes(base / section.mesh)
    return as_made_of([_piece(node, scene) for node in scene.graph.nodes_geometry], section)


def as_made_of(pieces: Sequence[Piece], section: VehicleSection) -> list[Piece]:
    """The pieces, each with the material that the section gives it."""
    kinds = material_kinds(dict.fromkeys(p.material for p in pieces), section.materials)
    return [replace(piece, kind=kinds[piece.material]) for piece in pieces]


def _piece(node: str, scene: trimesh.Scene) -> Piece:
    matrix, key = scene.graph[node]
    mesh = scene.geometry[key]
    normals = given_normals(mesh)
    faces = np.asarray(mesh.faces)
    if mesh.vertices.shape[1:] != (3,) or faces.min() < 0 or faces.max() >= len(mesh.vertices):
        raise MeshError(f"part '{node}': a triangle names a vertex that is not there; export again")
    if np.linalg.det(matrix[:3, :3]) < 0:  # a mirroring node turns triangles inside out
        faces = faces[:, ::-1]
    return Piece(
        name=node,
        material=material_name(mesh),
        kind="trim",
        vertices=trimesh.transform_points(mesh.vertices, matrix),
        faces=faces,
        normals=None if normals is None else normals @ np.linalg.pinv(matrix[:3, :3]),
        uvs=file_uvs(mesh),
        picture=own_picture(mesh),
        groups=tuple(mesh.metadata.get("groups", ())),
    )


def paint_picture(pieces: Sequence[Piece]) -> Image.Image | None:
    """The one picture of the file that all painted pieces wear; None without one, or with more.

    One that cannot be decoded does not count.
    """
    pictures = {_name(piece.picture): piece.picture for piece in pieces if piece.kind == "paint"}
    picture = next(iter(pictures.values())) if len(pictures) == 1 else None
    try:
        return None if picture is None else picture.convert("RGB")
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError):
        return None


def _name(picture: Image.Image | None) -> object:
    return picture and (picture.info.get("file_path") or id(picture))


def sound(pieces: Sequence[Piece]) -> list[Piece]:
    """The pieces without triangles that have no area or a corner that is not a number."""
    kept = (replace(piece, faces=piece.faces[piece.areas > 0]) for piece in pieces)
    return [piece for piece in kept if len(piece.faces)]


def turned(pieces: Sequence[Piece], section: VehicleSection) -> list[Piece]:
    """The pieces in our axes and metres, as the section reads them; the ground stays where it is.

    Raises MeshError where the section's up and front are not two different axes.
    """
    rotation = to_our_axes(Path(section.mesh), section.up, section.front)
    return [
        replace(
            piece,
            vertices=section.scale * piece.vertices @ rotation.T,
            normals=None if piece.normals is None else piece.normals @ rotation.T,
        )
        for piece in pieces
    ]
