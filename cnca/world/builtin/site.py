"""A world in the making: meshes by surface, things with labels, and places kept free."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from cnca.world.builtin.finishes import FINISHES
from cnca.world.builtin.meshes import Mesh, merge
from cnca.world.model import Lamp, Piece, Place, World, WorldObject


@dataclass(frozen=True)
class Pose:
    """Axes of a part of the world: its origin in the world, and the heading of its x axis."""

    x: float = 0.0
    y: float = 0.0
    heading: float = 0.0
    """Degrees counter-clockwise from +x, seen from above."""
    z: float = 0.0

    def point(self, x: float, y: float) -> tuple[float, float]:
        """A point of these axes in the axes that they stand in."""
        c, s = math.cos(math.radians(self.heading)), math.sin(math.radians(self.heading))
        return self.x + c * x - s * y, self.y + s * x + c * y

    def then(self, x: float, y: float, heading: float = 0.0, up: float = 0.0) -> Pose:
        """Axes at a point of these axes, turned further and ``up`` metres higher."""
        return Pose(*self.point(x, y), self.heading + heading, self.z + up)


class Site:
    """Collects what the builders make; everything is given in the axes of a pose."""

    def __init__(self) -> None:
        self._meshes: dict[str, list[Mesh]] = defaultdict(list)
        self._objects: list[tuple[str, dict[str, Mesh]]] = []
        self._lamps: list[Lamp] = []
        self.taken: list[tuple[float, float]] = []
        """Middles of the traffic."""

    def add(self, surface: str, mesh: Mesh, pose: Pose) -> None:
        """Put a mesh of a surface where ``pose`` says."""
        self._meshes[surface].append(mesh.placed(pose.x, pose.y, pose.z, pose.heading))

    def add_object(self, label: str, meshes: Mapping[str, Mesh], pose: Pose) -> None:
        """Put something that detectors know, made of one mesh for each surface."""
        placed = {s: m.placed(pose.x, pose.y, pose.z, pose.heading) for s, m in meshes.items()}
        self._objects.append((label, placed))

    def add_lamp(self, lamp: Lamp, pose: Pose) -> None:
        """Put what shines; what holds it is added apart."""
        x, y, z = lamp.position
        across, along, up = lamp.direction
        c, s = math.cos(math.radians(pose.heading)), math.sin(math.radians(pose.heading))
        position = (*pose.point(x, y), pose.z + z)
        direction = (c * across - s * along, s * across + c * along, up)
        self._lamps.append(replace(lamp, position=position, direction=direction))

    def free(self, place: Place, distance: float) -> bool:
        """Whether no traffic has its middle within ``distance`` metres of the place."""
        return all(math.hypot(place.x - x, place.y - y) > distance for x, y in self.taken)

    def world(self, name: str, places: Iterable[Place]) -> World:
        """Everything collected; surfaces that nothing uses are left out."""
        pieces = [_piece(name, name, merge(meshes)) for name, meshes in self._meshes.items()]
        objects = []
        for number, (label, meshes) in enumerate(self._objects):
            indices = tuple(range(len(pieces), len(pieces) + len(meshes)))
            pieces += [_piece(f"{label}_{number}_{s}", s, mesh) for s, mesh in meshes.items()]
            objects.append(WorldObject(label, indices))
        used = sorted({piece.surface for piece in pieces})
        surfaces = {surface: FINISHES[surface].surface() for surface in used}
        lamps = tuple(self._lamps)
        return World(name, tuple(pieces), surfaces, tuple(objects), tuple(places), lamps)


def _piece(name: str, surface: str, mesh: Mesh) -> Piece:
    finish = FINISHES[surface]
    uvs = None if finish.picture is None else mesh.uvs / np.array(finish.tile)
    return Piece(name, surface, mesh.vertices, mesh.faces, mesh.normals, uvs)
