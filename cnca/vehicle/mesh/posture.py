"""How a vehicle stands in its file: its axes, guessed from its shape.

Cars are mirror images of themselves from left to right, and less so in other ways; they are longer
than wide or high; their roof is shorter than their floor and lies behind the middle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from cnca.vehicle.mesh.pieces import Piece
from cnca.vehicle.mesh.sight import sample_surface

POINTS = 6000
MORE_ALIKE = 1.5
"""How many times nearer to its mirror image a car is from left to right than in other ways."""
ROOF = 0.8
"""Share of the height above which there is only the roof."""
MIDDLE = 0.52
"""Where the roof's middle lies at most, from tail (0) to nose (1): five built-in cars, the E-Tron
and the glTF vehicle have it at 0.35 to 0.49."""
WIDENED = 1.2
"""A car whose highest quarter is this many times longer than its lowest one is upside down."""


@dataclass(frozen=True)
class Posture:
    """Axes of the file."""

    up: str
    front: str
    """With a sign, such as +x."""
    upside_down: bool
    """Its height runs against ``up``; no scene key says so."""


def posture(pieces: Sequence[Piece], up: str, front: str) -> Posture:
    """The axes that the shape speaks for; where it is undecided, the ``up`` and ``front`` given.

    Where head and tail lights are known by name they say which end is the front.
    """
    points = sample_surface(np.concatenate([piece.triangles for piece in pieces]), POINTS)[1]
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    length = int(size.argmax())
    others = [axis for axis in range(3) if axis != length]
    unlike = [_unlike_mirrored(points, axis) for axis in others]
    height = others[int(np.argmax(unlike))]
    if max(unlike) < MORE_ALIKE * min(unlike) and "xyz".index(up) in others:
        height = "xyz".index(up)
    place = (points - low) / np.maximum(size, 1e-12)
    top, bottom = place[:, height] >= 0.75, place[:, height] <= 0.25
    upside_down = bool(np.ptp(place[top, length]) > WIDENED * np.ptp(place[bottom, length]))
    forwards = _forwards(pieces, place, length, height, upside_down)
    if forwards is None:
        forwards = -1 if front == "-" + "xyz"[length] else 1
    sign = "+" if forwards > 0 else "-"
    return Posture("xyz"[height], sign + "xyz"[length], upside_down)


def _unlike_mirrored(points: Float[np.ndarray, "points 3"], axis: int) -> float:
    """Mean distance of the points to their mirror image across the middle of an axis."""
    mirrored = points.copy()
    mirrored[:, axis] = points[:, axis].min() + points[:, axis].max() - points[:, axis]
    return float(cKDTree(points).query(mirrored)[0].mean())


def _forwards(
    pieces: Sequence[Piece],
    place: Float[np.ndarray, "points 3"],
    length: int,
    height: int,
    upside_down: bool,
) -> int | None:
    """1 where the nose has the larger coordinate, −1 where the tail has it; None if unclear."""
    lights = {
        kind: [p.triangles[..., length].mean() for p in pieces if p.kind == kind]
        for kind in ("light", "tail_light")
    }
    if all(lights.values()):
        return 1 if np.mean(lights["light"]) > np.mean(lights["tail_light"]) else -1
    above = 1 - place[:, height] if upside_down else place[:, height]
    roof = place[above > ROOF, length].mean()
    if roof > MIDDLE:
        return -1
    return 1 if roof < 1 - MIDDLE else None
