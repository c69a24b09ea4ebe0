"""Which triangles of a vehicle are seen from outside, and from which of their sides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from cnca.vehicle.mesh.pieces import Piece
from cnca.vehicle.mesh.surface import face_crosses

CELLS = 100
"""Cells per length of the vehicle."""
SAMPLES = 200_000
DIRECTIONS = ((0, 1), (0, -1), (1, 1), (1, -1), (2, 1))
"""Axis and sign of where the vehicle is seen from: nose, tail, both sides, above."""


@dataclass(frozen=True)
class Sight:
    """Points on the vehicle that are seen, about equally many per area of what is seen."""

    piece: Int[np.ndarray, " points"]
    face: Int[np.ndarray, " points"]
    """Index within its piece."""
    back: Bool[np.ndarray, " points"]
    """Whether the triangle is seen from behind."""

    def share(self, chosen: Bool[np.ndarray, " points"]) -> float:
        """Share of the chosen points among all."""
        return float(chosen.mean()) if len(chosen) else 0.0


def look_around(pieces: Sequence[Piece]) -> Sight:
    """The points on the surface that are seen: the foremost ones in their cell of a grid.

    The pieces are in our axes.
    """
    crosses = np.concatenate([face_crosses(piece.vertices, piece.faces) for piece in pieces])
    piece = np.repeat(np.arange(len(pieces)), [len(one.faces) for one in pieces])
    within = np.concatenate([np.arange(len(one.faces)) for one in pieces])
    face, points = sample_surface(np.concatenate([one.triangles for one in pieces]), SAMPLES)
    place = (points - points.min(axis=0)) / np.ptp(points, axis=0).max() * CELLS
    shown, backs = [], []
    for axis, sign in DIRECTIONS:
        column, row = np.delete(place, axis, axis=1).astype(int).T
        cell = row * (CELLS + 1) + column
        order = np.lexsort([-sign * points[:, axis], cell])
        seen = order[np.diff(cell[order], prepend=-1) > 0]
        shown.append(face[seen])
        backs.append(sign * crosses[face[seen], axis] < 0)
    seen = np.concatenate(shown)
    return Sight(piece[seen], within[seen], np.concatenate(backs))


def sample_surface(
    triangles: Float[np.ndarray, "faces 3 3"], count: int
) -> tuple[Int[np.ndarray, " count"], Float[np.ndarray, "count 3"]]:
    """Faces and points drawn evenly over the area, always the same ones."""
    rng = np.random.default_rng(0)
    edges = triangles[:, 1:] - triangles[:, :1]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    face = rng.choice(len(area), count, p=area / area.sum())
    cuts = np.sort(rng.random((count, 2)), axis=1)
    shares = np.diff(cuts, axis=1, prepend=0, append=1)
    return face, np.einsum("nc,ncd->nd", shares, triangles[face])
