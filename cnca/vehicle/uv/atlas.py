"""The paint's UV atlas: five plane projections, each one chart, laid out in rows.

::

    left side          rows from v = 1 downwards; all charts have the same scale (no stretch
    right side         but that of the projection), are seen from outside, never mirrored, and
    bonnet–roof–boot   text on the sides, the nose and the tail stands upright
    nose | tail
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cnca.vehicle.mesh.surface import Surface, join

PADDING = 8 / 512
"""Free space around every chart, in units of the atlas."""


@dataclass(frozen=True)
class Chart:
    """A projection onto a plane: u and v as directions in the vehicle's axes."""

    name: str
    u: tuple[float, float, float]
    v: tuple[float, float, float]


LEFT = Chart("left", (-1, 0, 0), (0, 0, 1))
RIGHT = Chart("right", (1, 0, 0), (0, 0, 1))
TOP = Chart("top", (-1, 0, 0), (0, -1, 0))
NOSE = Chart("nose", (0, 1, 0), (0, 0, 1))
TAIL = Chart("tail", (0, -1, 0), (0, 0, 1))
ROWS = ((LEFT,), (RIGHT,), (TOP,), (NOSE, TAIL))


def paint_atlas(paint: Surface, ceiling: float) -> tuple[Surface, Float[np.ndarray, "vertices 2"]]:
    """Cut the painted surface into charts; return it with its UVs in [0, 1]², v upwards.

    Nose and tail end at the height ``ceiling`` in metres: what is above a tail gate's window is
    roof, or it would be an island of its own.
    """
    charts = _cut(paint, ceiling)
    plane = {c: charts[c].vertices @ np.array([c.u, c.v], float).T for row in ROWS for c in row}
    low = {c: points.min(axis=0) for c, points in plane.items()}
    size = {c: np.ptp(points, axis=0) for c, points in plane.items()}
    heights = [max(size[c][1] for c in row) for row in ROWS]
    across = [(1 - (len(row) + 1) * PADDING) / sum(size[c][0] for c in row) for row in ROWS]
    scale = min(*across, (1 - (len(ROWS) + 1) * PADDING) / sum(heights))
    uvs, top = [], 1.0
    for row, height in zip(ROWS, heights, strict=True):
        left = PADDING
        bottom = top - PADDING - scale * height
        for chart in row:
            uvs.append((plane[chart] - low[chart]) * scale + (left, bottom))
            left += scale * size[chart][0] + PADDING
        top = bottom
    return join([charts[c] for row in ROWS for c in row]), np.concatenate(uvs)


def _cut(paint: Surface, ceiling: float) -> dict[Chart, Surface]:
    """Each chart gets the faces that look along its normal; seams run where two do so equally."""
    nose, rest = paint.split(np.maximum(-_facing(paint, 0), paint.z - ceiling))
    tail, rest = rest.split(np.maximum(-_facing(rest, 0, -1), rest.z - ceiling))
    top, sides = rest.split(np.abs(rest.normals[:, 1]) - np.abs(rest.normals[:, 2]))
    right, left = sides.split(sides.y)
    return {LEFT: left, RIGHT: right, TOP: top, NOSE: nose, TAIL: tail}


def _facing(surface: Surface, axis: int, sign: int = 1) -> Float[np.ndarray, " vertices"]:
    """How much more a vertex looks along one axis than along the other two.

    Sloping tail gates, at 45°, belong to the tail as a whole, hence the factor.
    """
    others = np.delete(np.abs(surface.normals), axis, axis=1).max(axis=1)
    return 1.1 * sign * surface.normals[:, axis] - others
