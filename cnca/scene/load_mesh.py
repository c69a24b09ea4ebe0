"""Vehicles from OBJ, PLY, glTF and GLB files, or built in.

Texture coordinates end with v upwards, whatever the file says: OBJ and PLY store it so, glTF stores
v downwards (glTF 2.0 specification, section 3.8.3).  Pictures and colours in the files are ignored:
a scene brings its own textures.
"""

from __future__ import annotations

import io
import os
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float, Int

from cnca.errors import MeshError, did_you_mean
from cnca.scene.materials import MATERIALS
from cnca.scene.mesh import Part, Vehicle
from cnca.scene.sedan import BUILTIN_VEHICLES, build_sedan
from cnca.scene.unwrap import unwrap_paint

EXTENSIONS = (".obj", ".ply", ".gltf", ".glb")
BUILTIN = "builtin:"
FARTHEST = 1e9
"""Metres from the origin: what lies beyond overflows sooner or later."""
UV_TOLERANCE = 1e-3
"""How far outside [0, 1] exporters' rounding may put a texture coordinate."""

_NAMES = {
    "underbody": r"under.?body|chassis",
    "tail_light": r"brake|tail.?l|stop.?l|rear.?l(ight|amp)",
    "light": r"light|lamp|lens",
    "glass": r"glass|window|windscreen|windshield",
    "tyre": r"tyre|tire|rubber",
    "metal": r"chrome|metal|mirror|(?<![a-z])rim|steel|alumin",
    "plate": r"plate",
    "paint": r"paint|body|lacquer",
}
"""Our material → what a file's material of that kind is usually called; the first match wins."""


def resolve_vehicle(
    spec: str,
    base: str | Path = ".",
    *,
    up: str = "y",
    front: str = "+x",
    scale: float = 1.0,
    materials: Mapping[str, str] | None = None,
    unwrap: bool = False,
) -> Vehicle:
    """Return the vehicle that a scene file names: ``builtin:NAME`` or a path relative to ``base``.

    The other arguments are those of :func:`load_vehicle`; built-in vehicles need none.
    Raises MeshError for an unknown name or a file that cannot be used.
    """
    if not spec.startswith(BUILTIN):
        path = Path(base) / spec
        return load_vehicle(
            path, up=up, front=front, scale=scale, materials=materials, unwrap=unwrap
        )
    name = spec.removeprefix(BUILTIN)
    if name not in BUILTIN_VEHICLES:
        known = ", ".join(BUILTIN + known for known in BUILTIN_VEHICLES)
        hint = did_you_mean(name, BUILTIN_VEHICLES)
        raise MeshError(f"{spec}: no such built-in vehicle (there are {known}){hint}")
    return build_sedan(BUILTIN_VEHICLES[name], spec)


def load_vehicle(
    path: str | Path,
    *,
    up: str = "y",
    front: str = "+x",
    scale: float = 1.0,
    ground: bool = True,
    materials: Mapping[str, str] | None = None,
    unwrap: bool = False,
) -> Vehicle:
    """Read a vehicle and turn it to +x front, +y left, +z up, in metres.

    Args:
        path: an OBJ, PLY, glTF or GLB file.
        up: the file's upward axis, "x", "y" or "z".
        front: the file's forward axis, such as "+x" or "-z".
        scale: metres per unit of the file.
        ground: shift the vehicle up or down so that its lowest point lies on z = 0.
        materials: the file's material name → ours (see ``cnca.scene.materials``).  Names left out
            are guessed ("Paint_Red" is paint, "Rubber_Black" a tyre), unknown ones become trim; a
            file with one material is all paint.
        unwrap: give the paint a new atlas instead of the file's texture coordinates.

    Raises:
        MeshError: the file is missing, unreadable or empty, holds NaN, has no painted part, or has
            a painted part without texture coordinates in [0, 1].
    """
    path = Path(path)
    to_ours = np.eye(4)
    to_ours[:3, :3] = scale * to_our_axes(path, up, front)
    scene = read_meshes(path)
    names = {key: material_name(mesh) for key, mesh in scene.geometry.items()}
    kinds = _materials(path, set(names.values()), materials or {})
    parts = []
    for node in scene.graph.nodes_geometry:
        matrix, key = scene.graph[node]
        mesh, material = scene.geometry[key], kinds[names[key]]
        textured = material == "paint" and not unwrap
        parts.append(_part(path, node, material, mesh, to_ours @ matrix, textured=textured))
    if ground:
        lowest = min(part.vertices[:, 2].min() for part in parts)
        for part in parts:
            part.vertices[:, 2] -= lowest
    vehicle = Vehicle(path.stem, tuple(parts))
    return unwrap_paint(vehicle) if unwrap else vehicle


def read_meshes(path: Path) -> trimesh.Scene:
    """The file's surfaces as they stand in it; raises MeshError where there are none."""
    extension = path.suffix.lower()
    if extension not in EXTENSIONS:
        hint = did_you_mean(extension, EXTENSIONS)
        raise MeshError(f"{path}: not one of {', '.join(EXTENSIONS)}{hint}")
    if not os.path.isfile(path):  # also of names that no system takes
        raise MeshError(f"{path}: no such file; paths start at the scene file's folder")
    try:
        scene = _read_obj(path) if extension == ".obj" else trimesh.load_scene(path, process=False)
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


def _materials(path: Path, names: set[str], chosen: Mapping[str, str]) -> dict[str, str]:
    """The file's material names → ours."""
    for name, kind in chosen.items():
        if name not in names:
            raise MeshError(f"{path}: has no material '{name}'{did_you_mean(name, names)}")
        if kind not in MATERIALS:
            hint = did_you_mean(kind, MATERIALS)
            raise MeshError(f"{path}: material '{name}': '{kind}' is not known{hint}")
    if len(names) == 1 and not chosen:
        return dict.fromkeys(names, "paint")
    kinds = {name: chosen.get(name) or guess_material(name) for name in names}
    if "paint" not in kinds.values():
        listed = ", ".join(sorted(names))
        raise MeshError(f"{path}: which material is paint? It has {listed}; map one to 'paint'")
    return kinds


def guess_material(name: str) -> str:
    """Our material that a material or part of this name is probably made of, else trim."""
    matches = (kind for kind, words in _NAMES.items() if re.search(words, name.lower()))
    return next(matches, "trim")


def to_our_axes(path: Path, up: str, front: str) -> Float[np.ndarray, "3 3"]:
    """The rotation whose rows are our front, left and up in the file's axes.

    Raises MeshError where ``up`` and ``front`` are no two axes; ``path`` stands in its message.
    """
    if not re.fullmatch("[xyz]", up) or not re.fullmatch("[+-][xyz]", front) or up == front[1]:
        raise MeshError(
            f"{path}: up '{up}' and front '{front}' must be different axes, e.g. 'y' and '+x'"
        )
    axes = dict(zip("xyz", np.eye(3), strict=True))
    forward = axes[front[1]] * (1 if front[0] == "+" else -1)
    return np.stack([forward, np.cross(axes[up], forward), axes[up]])


def _part(
    path: Path,
    name: str,
    material: str,
    mesh: trimesh.Trimesh,
    to_ours: Float[np.ndarray, "4 4"],
    *,
    textured: bool,
) -> Part:
    """One piece of the file in our axes, without unused vertices and triangles of no area."""
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
