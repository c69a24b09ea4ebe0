"""What a mesh file holds, read by trimesh and turned into parts.

Apart from ``load_mesh``, since trimesh is slow to import and built-in vehicles do without it.
"""

from __future__ import annotations

import io
import os
import re
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float, Int

from cnca.core.errors import MeshError, did_you_mean
from cnca.vehicle.model import Part

EXTENSIONS = (".obj", ".ply", ".gltf", ".glb")
FARTHEST = 1e9
"""Metres from the origin: what lies beyond overflows sooner or later."""
UV_TOLERANCE = 1e-3
"""How far outside [0, 1] exporters' rounding may put a texture coordinate."""


def read_meshes(path: Path) -> trimesh.Scene:
    """The file's surfaces as they stand in it; raises MeshError where there are none."""
    extension = path.suffix.lower()
    if extension not in EXTENSIONS:
        hint = did_you_mean(extension, EXTENSIONS)
        raise MeshError(f"{path}: not one of {', '.join(EXTENSIONS)}{hint}")
    if not os.path.isfile(path):  # also of names that no system takes
        raise MeshError(f"{path}: no such file; paths start at the scene file's folder")
    try:
        scene = _read_obj(path) if extension == ".obj" else _read(path, extension)
    except Exception as error:  # trimesh's readers raise whatever a broken file makes them raise
        reason = " ".join(str(error).split()) or type(error).__name__
        kind = extension.removeprefix(".").upper()
        raise MeshError(f"{path}: cannot be read as {kind} ({reason}); export it again") from error
    surfaces = {
        key: mesh
        for key, mesh in scene.geometry.items()
        if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces)
    }
    scene.delete_geometry(set(scene.geometry) - set(surfaces))
    if not surfaces:
        raise MeshError(f"{path}: holds no triangles; export the mesh, not only points or curves")
    if not len(scene.graph.nodes_geometry):
        raise MeshError(f"{path}: its scene shows none of its meshes; export the whole scene")
    return scene


def _read(path: Path, extension: str) -> trimesh.Scene:
    """Another kind of file, read from memory: an open one makes room for all a chunk claims."""
    return trimesh.load_scene(
        io.BytesIO(path.read_bytes()),
        file_type=extension.removeprefix("."),
        resolver=trimesh.resolvers.FilePathResolver(str(path)),
        process=False,
    )


def _read_obj(path: Path) -> trimesh.Scene:
    """Read an OBJ with its material names, but without the MTL file, which is often missing.

    trimesh takes the names from the MTL alone; a made-up one with just the names stands in for it.
    """
    text = path.read_text(encoding="utf-8", errors="replace")
    names = sorted(set(re.findall(r"^\s*usemtl\s+(\S.*?)\s*$", text, re.MULTILINE)))
    mtl = "".join(f"newmtl {name}\nKd 1 1 1\n" for name in names).encode()
    resolver = trimesh.resolvers.ZipResolver({"names.mtl": io.BytesIO(mtl)})
    obj = io.StringIO("mtllib names.mtl\n" + re.sub(r"(?m)^\s*mtllib.*$", "", text))
    return trimesh.load_scene(obj, file_type="obj", resolver=resolver, process=False)


def material_name(mesh: trimesh.Trimesh) -> str:
    """The file's name of what the mesh is made of, or "unnamed"."""
    return getattr(getattr(mesh.visual, "material", None), "name", None) or "unnamed"


def read_part(
    path: Path,
    name: str,
    material: str,
    mesh: trimesh.Trimesh,
    to_ours: Float[np.ndarray, "4 4"],
    *,
    textured: bool,
) -> Part:
    """One piece of the file in our axes, without unused vertices and triangles of no area.

    Raises MeshError for what cannot be rendered: NaN, no area, wrong or no texture coordinates.
    """
    if mesh.vertices.shape[1:] != (3,):  # trimesh takes what a file gives
        raise MeshError(f"{path}: part '{name}': a vertex has x, y and z; export it again")
    if not np.isfinite(mesh.vertices).all():
        count = int(np.count_nonzero(~np.isfinite(mesh.vertices).all(axis=1)))
        raise MeshError(f"{path}: part '{name}': {count} vertices are NaN or infinite; repair it")
    if mesh.faces.min() < 0 or mesh.faces.max() >= len(mesh.vertices):
        raise MeshError(f"{path}: part '{name}': a triangle names a vertex that does not exist")
    vertices = trimesh.transform_points(mesh.vertices, to_ours)
    if not np.isfinite(vertices).all() or np.abs(vertices).max() > FARTHEST:
        raise MeshError(f"{path}: part '{name}': reaches beyond {FARTHEST:g} m; check its scale")
    if not abs(np.linalg.det(to_ours[:3, :3])) > 0:
        raise MeshError(f"{path}: part '{name}': its node makes it flat; repair its matrix")
    faces = mesh.faces[mesh.area_faces > 0]
    if not len(faces):
        raise MeshError(f"{path}: part '{name}': all triangles have zero area; remove the part")
    used, faces = np.unique(faces, return_inverse=True)
    faces = faces.reshape(-1, 3)
    normals = _normals(mesh, used, faces) @ np.linalg.inv(to_ours[:3, :3])
    if np.linalg.det(to_ours[:3, :3]) < 0:  # a mirroring node turns triangles inside out
        faces = faces[:, ::-1]
    return Part(
        name=name,
        material=material,
        vertices=vertices[used],
        faces=np.ascontiguousarray(faces),
        normals=normals / np.linalg.norm(normals, axis=1, keepdims=True),
        uvs=_uvs(path, name, mesh, used) if textured else None,
    )


def _normals(
    mesh: trimesh.Trimesh, used: Int[np.ndarray, " kept"], faces: Int[np.ndarray, "faces 3"]
) -> Float[np.ndarray, "kept 3"]:
    """The file's normals; where it has none, the smooth ones of the surface without UV seams."""
    vertices = np.asarray(mesh.vertices[used])
    positions, welded = np.unique(vertices, axis=0, return_inverse=True)
    surface = trimesh.Trimesh(positions, welded[faces], process=False)
    smooth = surface.vertex_normals[welded]
    # Both sides of a thin sheet, welded, cancel out: take the normal of any triangle there.
    flat = np.zeros_like(vertices)
    flat[faces] = surface.face_normals[:, None]
    normals = np.where(_is_unit(smooth), smooth, flat)
    if "vertex_normals" in mesh._cache:  # trimesh tells nowhere else whether the file had normals
        given = np.asarray(mesh.vertex_normals[used])
        normals = np.where(_is_unit(given), given, normals)
    return normals


def _is_unit(vectors: Float[np.ndarray, "vectors 3"]) -> np.ndarray:
    return np.abs(np.linalg.norm(vectors, axis=1, keepdims=True) - 1) < 0.01


def _uvs(
    path: Path, name: str, mesh: trimesh.Trimesh, used: Int[np.ndarray, " kept"]
) -> Float[np.ndarray, "kept 2"]:
    uvs = getattr(mesh.visual, "uv", None)
    if uvs is None or len(uvs) != len(mesh.vertices):
        raise MeshError(
            f"{path}: painted part '{name}' has no texture coordinates; export them or set unwrap"
        )
    uvs = np.asarray(uvs[used], float)
    if not np.isfinite(uvs).all() or uvs.min() < -UV_TOLERANCE or uvs.max() > 1 + UV_TOLERANCE:
        raise MeshError(
            f"{path}: painted part '{name}': texture coordinates span "
            f"[{uvs.min():.3g}, {uvs.max():.3g}]; pack them into [0, 1] or set unwrap"
        )
    return uvs.clip(0, 1)
