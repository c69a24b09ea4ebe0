"""Where in a world there is ground to stand on."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cnca.core.errors import SceneError
from cnca.world.model import World

HEADROOM = 2.0
"""Metres of free space over what a vehicle can stand on."""
LEVEL = 0.5
"""Least vertical part of the normal of what counts as ground (60° of slope)."""


def ground_under(world: World, x: float, y: float) -> float:
    """Height of the lowest surface at (x, y) that looks up and has free space above it.

    Under a bridge this is the road below; the terrain under a road has no free space.

    Raises:
        SceneError: there is none.
    """
    heights = crossings(world, x, y)
    if world.ground:
        heights = np.append(heights, 0.0)
    heights = np.unique(heights)
    free = heights[np.append(np.diff(heights) > HEADROOM, True)] if len(heights) else heights
    if not len(free):
        low, high = bounds(world)
        raise SceneError(
            f"world.at: {world.name} has no ground at ({x:g}, {y:g}); it spans "
            f"x {low[0]:.1f} to {high[0]:.1f} and y {low[1]:.1f} to {high[1]:.1f} metres"
        )
    return float(free[0])


def crossings(world: World, x: float, y: float) -> Float[np.ndarray, " heights"]:
    """Heights at which a plumb line meets surfaces that look up."""
    heights = []
    for piece in world.pieces:
        a, b, c = np.moveaxis(piece.vertices[piece.faces], 1, 0)
        near = (np.minimum(np.minimum(a, b), c)[:, :2] <= (x, y)).all(axis=1)
        near &= (np.maximum(np.maximum(a, b), c)[:, :2] >= (x, y)).all(axis=1)
        a, b, c = a[near], b[near], c[near]
        normal = np.cross(b - a, c - a)
        steep = np.abs(normal[:, 2]) < LEVEL * np.linalg.norm(normal, axis=1)
        a, b, c, normal = a[~steep], b[~steep], c[~steep], normal[~steep]
        point = np.array([x, y])
        inside = np.ones(len(a), bool)
        for start, end in ((a, b), (b, c), (c, a)):
            edge, away = (end - start)[:, :2], point - start[:, :2]
            inside &= (edge[:, 0] * away[:, 1] - edge[:, 1] * away[:, 0]) * normal[:, 2] >= 0
        slope = ((point - a[:, :2]) * normal[:, :2]).sum(axis=1) / np.where(
            normal[:, 2] == 0, 1, normal[:, 2]
        )
        heights.append((a[:, 2] - slope)[inside])
    return np.concatenate(heights) if heights else np.zeros(0)


def bounds(world: World) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Lowest and highest corner of the world's box; zeros for an empty one."""
    boxes = [(p.vertices.min(axis=0), p.vertices.max(axis=0)) for p in world.pieces if p.faces.size]
    if not boxes:
        return np.zeros(3), np.zeros(3)
    return np.min([low for low, _ in boxes], axis=0), np.max([high for _, high in boxes], axis=0)
