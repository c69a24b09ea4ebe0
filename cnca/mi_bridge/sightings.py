"""Which of a world's labelled objects a camera sees, where, and how much of them is hidden."""

from __future__ import annotations

import numpy as np

from cnca.mi_bridge.geometry import Geometry
from cnca.mi_bridge.rays import Cameras
from cnca.mi_bridge.variant import dr, mi
from cnca.mi_bridge.world_shapes import make_mesh
from cnca.scene.layers import Sighting
from cnca.world.model import World, WorldObject

NEARNESS = 1e-4
"""Relative difference up to which two distances are those of one surface."""


class Sightings:
    """A world's objects, each as a scene of its own, to look for them in pictures of all."""

    def __init__(self, world: World) -> None:
        self._objects = [(o.label, _alone(world, o)) for o in world.objects]

    def look(self, geometry: Geometry, cameras: Cameras) -> list[list[Sighting]]:
        """For each view, the objects that at least one pixel's centre shows.

        An object is hidden where something is nearer than its own nearest surface.
        """
        shape = (cameras.count, cameras.height, cameras.width)
        views: list[list[Sighting]] = [[] for _ in range(cameras.count)]
        with dr.suspend_grad():
            ray, _ = cameras.rays(1)
            nearest = np.array(geometry.scene.ray_intersect(ray).t).reshape(shape)
            for label, scene in self._objects:
                distance = np.array(scene.ray_intersect(ray).t).reshape(shape)
                there = np.isfinite(distance)
                seen = there & (nearest >= distance * (1 - NEARNESS))
                for view in np.flatnonzero(seen.any(axis=(1, 2))):
                    occluded = 1 - seen[view].sum() / there[view].sum()
                    views[view].append(Sighting(label, seen[view], float(occluded)))
        return views


def _alone(world: World, thing: WorldObject) -> mi.Scene:
    bsdf = mi.load_dict({"type": "diffuse"})
    pieces = [world.pieces[i] for i in thing.pieces if len(world.pieces[i].faces)]
    meshes = {
        f"piece_{k}": make_mesh(p.name, bsdf, p.vertices, p.faces, p.normals, None)
        for k, p in enumerate(pieces)
    }
    return mi.load_dict({"type": "scene", **meshes})
