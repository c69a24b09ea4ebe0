"""What a mesh file holds, read by trimesh and turned into parts.

Separate from ``load_mesh``, since trimesh is slow to import and built-in vehicles do without it.
"""

from __future__ import annotations

import io
import os
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float, Int
from PIL import Image

from cnca.core.errors import MeshError, did_you_mean
from cnca.vehicle.mesh.finder import Finder
from cnca.vehicle.mesh.gltf.plain import plain_glb
from cnca.vehicle.mesh.normals import split_normals
from cnca.vehicle.mesh.obj import read_obj
from cnca.vehicle.mesh.ply import read_ply
from cnca.vehicle.model import Part

GLTF = (".gltf", ".glb")
EXTENSIONS = (".obj", ".ply", ".stl", *GLTF)
CONVERTED = (".3ds", ".abc", ".blend", ".dae", ".fbx", ".max", ".usd", ".usda", ".usdc", ".usdz")
"""What modelling programs turn into glTF; Blender, which is free, reads all of it but .max."""
FARTHEST = 1e9
"""Metres from the origin: what lies beyond overflows sooner or later."""
UV_TOLERANCE = 1e-3
"""How far outside [0, 1] exporters' rounding may put a texture coordinate."""


def read_meshes(path: Path, finder: Finder | None = None) -> trimesh.Scene:
    """The file's surfaces as they stand in it; raises MeshError where there are none.

    ``finder`` finds the files that it names, and keeps what it found.
    """
    extension = path.suffix.lower()
    if extension not in EXTENSIONS:
        hint = did_you_mean(extension, EXTENSIONS)
        if extension in CONVERTED:
            hint = "; open it in Blender and choose File, Export, glTF 2.0"
        raise MeshError(f"{path}: not one of {', '.join(EXTENSIONS)}{hint}")
    if not os.path.isfile(path):  # false, too, for names that no system takes
        raise MeshError(f"{path}: no such file; paths start at the scene file's folder")
    try:
        scene = _read(path, extension, finder or Finder(path))
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from None
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


def _read(path: Path, extension: str, finder: Finder) -> trimesh.Scene:
    """Read from memory: an open file makes room for all that a chunk claims to hold."""
    data = path.read_bytes()
    if extension == ".obj":
        return read_obj(data, path.stem, finder.get)
    if extension == ".ply":
        return trimesh.Scene(read_ply(data, finder.get))
    if extension in GLTF:
        data, extension = plain_glb(data, finder.get), ".glb"
    return trimesh.load_scene(
        io.BytesIO(data), file_type=extension.removeprefix("."), resolver=finder, process=False
    )


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
) -> tuple[Part, Int[np.ndarray, " kept"]]:
    """One piece of the file in our axes, without triangles of zero area; and its vertices' indices.

    Vertices on creases are doubled.  Raises MeshError for what cannot be rendered: NaN, no area,
    wrong or no texture coordinates.
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
    faces = np.asarray(mesh.faces[mesh.area_faces > 0])
    if not len(faces):
        raise MeshError(f"{path}: part '{name}': all triangles have zero area; remove the part")
    given = given_normals(mesh)
    kept, faces, normals = split_normals(np.asarray(mesh.vertices), faces, given)
    normals = normals @ np.linalg.inv(to_ours[:3, :3])
    if np.linalg.det(to_ours[:3, :3]) < 0:  # a mirroring node turns triangles inside out
        faces = faces[:, ::-1]
    part = Part(
        name=name,
        material=material,
        vertices=vertices[kept],
        faces=np.ascontiguousarray(faces),
        normals=normals / np.linalg.norm(normals, axis=1, keepdims=True),
        uvs=_uvs(path, name, mesh, kept) if textured else None,
    )
    return part, kept


def own_picture(mesh: trimesh.Trimesh) -> Image.Image | None:
    """The picture of the base color that the file names or holds, where it lies."""
    material = getattr(mesh.visual, "material", None)
    picture = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    return picture if isinstance(picture, Image.Image) else None


def given_normals(mesh: trimesh.Trimesh) -> Float[np.ndarray, "vertices 3"] | None:
    """The normals that the file has; trimesh itself would make some where there are none."""
    if "vertex_normals" not in mesh._cache:  # the only place that tells
        return None
    return np.asarray(mesh.vertex_normals, float)


def file_uvs(mesh: trimesh.Trimesh) -> Float[np.ndarray, "vertices 2"] | None:
    """The texture coordinates that the file has, v upwards; None where a vertex has none."""
    uvs = getattr(mesh.visual, "uv", None)
    return None if uvs is None or len(uvs) != len(mesh.vertices) else np.asarray(uvs, float)


def _uvs(
    path: Path, name: str, mesh: trimesh.Trimesh, kept: Int[np.ndarray, " kept"]
) -> Float[np.ndarray, "kept 2"]:
    uvs = file_uvs(mesh)
    if uvs is None:
        raise MeshError(
            f"{path}: painted part '{name}' has no texture coordinates; export them or set unwrap"
        )
    uvs = uvs[kept]
    if not np.isfinite(uvs).all() or uvs.min() < -UV_TOLERANCE or uvs.max() > 1 + UV_TOLERANCE:
        raise MeshError(
            f"{path}: painted part '{name}': texture coordinates span "
            f"[{uvs.min():.3g}, {uvs.max():.3g}]; pack them into [0, 1] or set unwrap"
        )
    return uvs.clip(0, 1)
