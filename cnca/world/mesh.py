"""Worlds from OBJ, PLY, glTF and GLB files, with the materials and pictures that they name.

Pictures are taken from where the file says; where there is nothing, from where a picture of that
name lies in the file's folder or near it: exporters write paths of machines that no longer exist.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import trimesh

from cnca.core.errors import MeshError
from cnca.vehicle.mesh.load_mesh import to_our_axes
from cnca.vehicle.mesh.mesh_file import file_uvs, read_part
from cnca.world.materials import material_surface
from cnca.world.model import Piece, Place, Surface, World
from cnca.world.reading import read_world

GLTF = (".gltf", ".glb")


def load_world(path: str | Path, *, up: str | None = None, scale: float = 1.0) -> World:
    """Read a world and turn it to +z up, in metres; what the file calls (0, 0, 0) stays there.

    Args:
        up: the file's upward axis; by default y for glTF, whose specification says so, else z.
        scale: metres per unit of the file.

    Raises:
        MeshError: the file is missing, unreadable or empty, or holds NaN.
    """
    path = Path(path)
    reading = read_world(path)
    up = up or ("y" if path.suffix.lower() in GLTF else "z")
    to_ours = np.eye(4)
    to_ours[:3, :3] = scale * to_our_axes(path, up, "+y" if up == "x" else "+x")
    surfaces: dict[str, Surface] = {}
    names: dict[int, str] = {}
    pieces = []
    for node in reading.scene.graph.nodes_geometry:
        matrix, key = reading.scene.graph[node]
        mesh = reading.scene.geometry[key]
        if not (mesh.area_faces > 0).any():
            continue  # a world may hold what a vehicle may not
        material = getattr(mesh.visual, "material", None)
        if id(material) not in names:
            surface = material_surface(mesh)
            name = getattr(material, "name", None) or "unnamed"
            name = name if name not in surfaces else f"{name}_{len(surfaces)}"
            surfaces[name], names[id(material)] = surface, name
        pieces.append(_piece(path, node, names[id(material)], mesh, to_ours @ matrix))
    if not pieces:
        raise MeshError(f"{path}: all of its triangles have zero area; export it again")
    source = {str(file): hashlib.sha256(file.read_bytes()).hexdigest() for file in reading.files}
    return World(path.stem, tuple(pieces), surfaces, places=(Place(0.0, 0.0),), source=source)


def _piece(
    path: Path, name: str, surface: str, mesh: trimesh.Trimesh, to_ours: np.ndarray
) -> Piece:
    part, kept = read_part(path, name, surface, mesh, to_ours, textured=False)
    uvs = file_uvs(mesh)
    if uvs is not None:
        uvs = np.nan_to_num(uvs[kept])
    return Piece(name, surface, part.vertices, part.faces, part.normals, uvs)
