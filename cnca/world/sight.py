"""What of a vehicle a world hides: a quick look, before a picture is worth its rays."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cnca.scene.cameras import View
from cnca.world.model import World

TARGETS = np.stack(
    np.meshgrid([-2.0, -1.0, 0.0, 1.0, 2.0], [-0.8, 0.0, 0.8], [0.3, 0.8, 1.3]), axis=-1
).reshape(-1, 3)
"""Points of a car around the origin, in metres."""

INSIDE = np.array([[x, y, 0.8] for x in (-1.5, 0.0, 1.5) for y in (-0.5, 0.5)])
"""Points well within any car, in metres; a low kerb or a bridge is not between them."""


class Sight:
    """A world around the origin, to look through from many sides."""

    def __init__(self, world: World) -> None:
        triangles = [piece.vertices[piece.faces] for piece in world.pieces if len(piece.faces)]
        self._corners = np.concatenate(triangles) if triangles else np.zeros((0, 3, 3))
        self._low, self._high = self._corners.min(axis=1), self._corners.max(axis=1)

    def is_free(self) -> bool:
        """Whether nothing stands between points within a car in the origin, such as a wall."""
        low, high = INSIDE.min(axis=0), INSIDE.max(axis=0)
        near = ((self._low <= high) & (self._high >= low)).all(axis=1)
        corners = self._corners[near]
        return not any(blocked(start, INSIDE, corners).any() for start in INSIDE)

    def share(self, view: View) -> float:
        """Share in [0, 1] of a car in the origin that no triangle hides from the camera.

        Holes in leaves are taken to be solid.
        """
        origin = np.array(view.origin)
        low, high = np.minimum(TARGETS.min(axis=0), origin), np.maximum(TARGETS.max(axis=0), origin)
        near = ((self._low <= high) & (self._high >= low)).all(axis=1)
        return 1.0 - float(blocked(origin, TARGETS, self._corners[near]).mean())


def blocked(
    origin: Float[np.ndarray, "3"],
    targets: Float[np.ndarray, "targets 3"],
    corners: Float[np.ndarray, "triangles 3 3"],
) -> np.ndarray:
    """Which targets a triangle hides from the origin (Möller & Trumbore 1997)."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    u_edge, v_edge, from_a = b - a, c - a, origin - a
    q = np.cross(from_a, u_edge)
    t_top = (v_edge * q).sum(axis=1)
    hidden = np.zeros(len(targets), bool)
    for k, target in enumerate(targets):
        d = target - origin
        p = np.cross(d, v_edge)
        determinant = (u_edge * p).sum(axis=1)
        flat = np.abs(determinant) < 1e-12
        scale = 1 / np.where(flat, 1.0, determinant)
        u, v, t = (from_a * p).sum(axis=1) * scale, (q @ d) * scale, t_top * scale
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < 1) & ~flat
        hidden[k] = hit.any()
    return hidden
