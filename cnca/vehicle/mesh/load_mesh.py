"""Vehicles from OBJ, PLY, glTF and GLB files, or built in.

Texture coordinates end up with v upwards, whatever the file says: OBJ and PLY store it that way,
glTF stores v downwards (glTF 2.0 specification, section 3.8.3).  Pictures and colors in the files
are ignored: a scene brings its own textures.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float

from cnca.core.errors import MeshError, did_you_mean
from cnca.scene.materials import MATERIALS
from cnca.vehicle.builtin.sedan import BUILTIN_VEHICLES, build_sedan
from cnca.vehicle.mesh.names import material_kinds
from cnca.vehicle.mesh.place import misplaced
from cnca.vehicle.model import Vehicle
from cnca.vehicle.uv.unwrap import unwrap_paint

BUILTIN = "builtin:"


def resolve_vehicle(
    spec: str,
    base: str | Path = ".",
    *,
    up: str = "y",
    front: str = "+x",
    scale: float = 1.0,
    materials: Mapping[str, str] | None = None,
    unwrap: bool = False,
    recentre: bool = True,
) -> Vehicle:
    """Return the vehicle that a scene file names: ``builtin:NAME`` or a path relative to ``base``.

    The other arguments are those of :func:`load_vehicle`; built-in vehicles need none.
    Raises MeshError for an unknown name or a file that cannot be used.
    """
    if not spec.startswith(BUILTIN):
        path = Path(base) / spec
        return load_vehicle(
            path,
            up=up,
            front=front,
            scale=scale,
            recentre=recentre,
            materials=materials,
            unwrap=unwrap,
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
    recentre: bool = True,
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
        recentre: shift a vehicle that stands away from the origin (:mod:`~cnca.vehicle.mesh.place`)
            onto it.
        materials: the file's material name → ours (see ``cnca.scene.materials``).  Names left out
            are guessed ("Paint_Red" is paint, "Rubber_Black" a tyre), unknown ones become trim; a
            file with one material is all paint.
        unwrap: give the paint a new atlas instead of the file's texture coordinates.

    Raises:
        MeshError: the file is missing, unreadable or empty, holds NaN, has no painted part, or has
            a painted part without texture coordinates in [0, 1].
    """
    from cnca.vehicle.mesh.mesh_file import material_name, read_meshes, read_part

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
        part, _ = read_part(path, node, material, mesh, to_ours @ matrix, textured=textured)
        parts.append(part)
    low = np.min([part.vertices.min(axis=0) for part in parts], axis=0)
    high = np.max([part.vertices.max(axis=0) for part in parts], axis=0)
    offset = misplaced(low, high) if recentre else np.zeros(3)
    offset[2] = low[2] if ground else 0.0
    for part in parts:
        part.vertices[:] -= offset
    vehicle = Vehicle(path.stem, tuple(parts))
    return unwrap_paint(vehicle) if unwrap else vehicle


def _materials(path: Path, names: set[str], chosen: Mapping[str, str]) -> dict[str, str]:
    """The file's material names → ours."""
    for name, kind in chosen.items():
        if name not in names:
            raise MeshError(f"{path}: has no material '{name}'{did_you_mean(name, names)}")
        if kind not in MATERIALS:
            hint = did_you_mean(kind, MATERIALS)
            raise MeshError(f"{path}: material '{name}': '{kind}' is not known{hint}")
    kinds = material_kinds(names, chosen)
    if "paint" not in kinds.values():
        listed = ", ".join(sorted(names))
        raise MeshError(
            f"{path}: which material is paint? It has {listed}; map one to 'paint' in "
            "vehicle.materials, as cnca check-vehicle proposes"
        )
    return kinds


def to_our_axes(path: Path, up: str, front: str) -> Float[np.ndarray, "3 3"]:
    """The rotation whose rows are our front, left and up in the file's axes.

    Raises MeshError where ``up`` and ``front`` are not two different axes; its message names
    ``path``.
    """
    if not re.fullmatch("[xyz]", up) or not re.fullmatch("[+-][xyz]", front) or up == front[1]:
        raise MeshError(
            f"{path}: up '{up}' and front '{front}' must be different axes, e.g. 'y' and '+x'"
        )
    axes = dict(zip("xyz", np.eye(3), strict=True))
    forward = axes[front[1]] * (1 if front[0] == "+" else -1)
    return np.stack([forward, np.cross(axes[up], forward), axes[up]])
