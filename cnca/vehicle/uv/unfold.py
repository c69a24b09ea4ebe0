"""A vehicle's outside, unfolded like a box around its top.

::

                right side           u and v in metres; every face is projected onto the side of
        nose |  top        | tail    the box that it looks at, so texels are at most √3 longer on
                left side            the car than in the atlas, and panels lie side by side across
                                     the gaps between them, however the mesh is cut up.  The outer
                                     charts are sheared a little to continue the top's edge.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_matrix
from scipy.spatial import cKDTree

from cnca.vehicle.mesh.surface import face_crosses

Corners2 = Float[np.ndarray, "faces 3 2"]

REACH = 0.12
"""Metres around a face whose orientation it shares: door gaps are not sides of their own."""
GRAZING = 0.3
"""Cosine under which a face is too steep for its side: hidden edges and undersides."""
CELL = 0.01
"""Metres per cell where charts are pushed together and hidden faces are found."""
SAME_LAYER = 0.015
"""Metres between two faces of one panel along the line of sight."""
MEET = 0.03
"""Most metres on the car between two charts that continue each other."""
SPACE = 0.05
"""Metres between charts in the atlas."""
CORNER = 0.5
"""Metres inside the outermost place where two charts meet that still belongs to their edge."""
KNOT = 0.05
"""Metres between the points at which the shift of a chart is free."""
STEEPEST = 1.0
"""Largest shear, as a slope."""
LARGE = 0.1
"""Square metres from which a face can be seen in most of its area and yet lie under others."""
STACKED = 0.05
"""Share of a large face's points at which others may lie, too."""
INSIDE = np.array([[2, 2, 2], [4, 1, 1], [1, 4, 1], [1, 1, 4]]) / 6
"""Points of a triangle at which it is looked at, in barycentric coordinates."""

MANY_INSIDE = np.array([(i, j, 24 - i - j) for i in range(1, 23) for j in range(1, 24 - i)]) / 24
"""More such points, away from the edges."""


@dataclass(frozen=True)
class Side:
    """One side of the box: u and v as directions in the vehicle's axes, seen from outside."""

    name: str
    u: tuple[int, int, int]
    v: tuple[int, int, int]

    @property
    def outwards(self) -> Float[np.ndarray, "3"]:
        """The side's normal."""
        return np.cross(self.u, self.v).astype(float)


TOP = Side("top", (-1, 0, 0), (0, -1, 0))
LEFT = Side("left", (-1, 0, 0), (0, 0, 1))
RIGHT = Side("right", (-1, 0, 0), (0, 0, -1))
NOSE = Side("nose", (0, 0, 1), (0, -1, 0))
TAIL = Side("tail", (0, 0, -1), (0, -1, 0))
SIDES = (TOP, LEFT, RIGHT, NOSE, TAIL)
APPROACH = ((0, 0), (0, -1), (0, 1), (-1, 0), (1, 0))
"""Where each side lies, seen from the top's chart."""


def unfold(
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    glass: Float[np.ndarray, "panes 3 3"],
    *,
    shear: float = 0.005,
) -> tuple[Bool[np.ndarray, " faces"], Bool[np.ndarray, " faces"], Corners2]:
    """Return which faces can be seen from outside, which found a place, and their corners.

    Corners are in metres and do not overlap; those without a place are zero.  What lies behind
    ``glass`` is not outside.  ``shear`` weighs the charts' shear against the mismatch along their
    common edges, in m².
    """
    side = sides(vertices, faces)
    outside = np.zeros(len(faces), bool)
    flat = np.zeros((len(faces), 3, 2))
    for i, direction in enumerate(SIDES):
        chosen = np.flatnonzero(side == i)
        corners = vertices[faces[chosen]]
        flat[chosen] = corners @ np.array([direction.u, direction.v], float).T
        behind = glass @ np.array([direction.u, direction.v], float).T, glass @ direction.outwards
        outside[chosen] = _front(flat[chosen], corners @ direction.outwards, *behind)
    placed = np.zeros(len(faces), bool)
    for i in range(len(SIDES)):
        chosen = outside & (side == i)
        if placed.any() and chosen.any():
            top = placed & (side == 0) if placed[side == 0].any() else placed
            flat[chosen] = _attach(vertices[faces], flat, top, chosen, i, shear)
            chosen[np.flatnonzero(chosen)[_covered(flat[placed], flat[chosen])]] = False
        placed |= chosen
        height = vertices[faces].mean(axis=1) @ SIDES[i].outwards
        placed &= ~_stacked(flat, placed, chosen, height)
    flat[~placed] = 0
    return outside, placed, flat


def sides(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> Int[np.ndarray, " faces"]:
    """Index into :data:`SIDES` for each face, −1 where it looks along none of them.

    A face follows the mean orientation of its surroundings as long as its own allows that.
    """
    crosses = face_crosses(vertices, faces)
    area = np.linalg.norm(crosses, axis=1)
    normals = crosses / np.maximum(area, 1e-12)[:, None]
    directions = np.stack([side.outwards for side in SIDES], axis=1)
    facing = normals @ directions
    middle = vertices[faces].mean(axis=1)
    pairs = cKDTree(middle).query_pairs(REACH, output_type="ndarray")
    # Faces that look away from each other belong to different layers of sheet metal.
    pairs = pairs[(normals[pairs[:, 0]] * normals[pairs[:, 1]]).sum(axis=1) > 0.3]
    i, j = np.concatenate([pairs, pairs[:, ::-1], np.arange(len(faces))[:, None].repeat(2, 1)]).T
    around = coo_matrix((area[j], (i, j)), shape=(len(faces), len(faces))).tocsr()
    common = around @ np.maximum(facing, 0)
    common[facing < GRAZING] = -1.0
    return np.where(common.max(axis=1) > 0, common.argmax(axis=1), -1)


def _front(
    flat: Corners2,
    height: Float[np.ndarray, "faces 3"],
    glass: Float[np.ndarray, "panes 3 2"],
    glass_height: Float[np.ndarray, "panes 3"],
) -> Bool[np.ndarray, " faces"]:
    """Which of one side's faces lie in front of all others, and of glass, in most of their area."""
    if not len(flat):
        return np.zeros(0, bool)
    every = np.concatenate([flat, glass])
    corners = (every - every.min(axis=(0, 1))) / CELL
    middle = np.concatenate([height, glass_height]).mean(axis=1)
    front = np.full(np.ceil(corners.max(axis=(0, 1))).astype(int)[::-1] + 2, -1, np.int32)
    for face in np.argsort(middle):  # the foremost is drawn last
        cv2.fillConvexPoly(front, np.rint(corners[face] * 16).astype(np.int32), int(face), shift=4)
    points = np.einsum("sc,fcd->fsd", INSIDE, corners[: len(flat)])
    column, row = np.rint(points).astype(int).transpose(2, 0, 1)
    owner = front[row, column]
    ahead = middle[owner] - np.einsum("sc,fc->fs", INSIDE, height)
    hits = (owner == np.arange(len(flat))[:, None]) | (ahead < SAME_LAYER)
    return hits.sum(axis=1) >= 3


def _attach(
    triangles: Float[np.ndarray, "faces 3 3"],
    flat: Corners2,
    top: Bool[np.ndarray, " faces"],
    chosen: Bool[np.ndarray, " faces"],
    index: int,
    shear: float,
) -> Float[np.ndarray, "chosen 3 2"]:
    """Shift the chart of side ``index``, a little sheared, to continue the top where both meet.

    Where they meet on the car is seen from corners less than :data:`MEET` apart.  The shift is a
    piecewise linear function g of the coordinate along the common edge: it minimizes
    Σ (g − wanted)² + shear · ∫ g′², and its slope stays below :data:`STEEPEST`.
    """
    side, direction = SIDES[index], APPROACH[index]
    along = 0 if direction[0] else 1
    chart, others = flat[chosen].reshape(-1, 2), flat[top].reshape(-1, 2)
    height = triangles[chosen].reshape(-1, 3) @ side.outwards
    tree = cKDTree(triangles[top].reshape(-1, 3))
    distance, nearest = tree.query(triangles[chosen].reshape(-1, 3), distance_upper_bound=MEET)
    met = np.isfinite(distance)
    across = chart[:, 1 - along]
    knots = np.arange(across.min() - KNOT, across.max() + 2 * KNOT, KNOT)
    if met.any():  # edges farther inside, behind a windscreen or a lid, are not the car's corner
        met &= height > height[met].max() - CORNER
        wanted = others[nearest[met], along] - chart[met, along]
        shift = _smooth(knots, across[met], wanted, shear) + direction[along] * SPACE
    else:  # nothing in common: beside it
        sign = direction[along]
        distance = (sign * others[:, along]).max() - (sign * chart[:, along]).min()
        shift = np.full(len(knots), sign * (distance + SPACE))
    moved = flat[chosen].copy()
    moved[..., along] += np.interp(moved[..., 1 - along], knots, shift)
    return moved


def _smooth(
    knots: Float[np.ndarray, " knots"],
    at: Float[np.ndarray, " points"],
    wanted: Float[np.ndarray, " points"],
    shear: float,
) -> Float[np.ndarray, " knots"]:
    """The smooth function at the knots that comes closest to the ``wanted`` values."""
    cell = ((at - knots[0]) / KNOT).astype(int)
    counts = np.bincount(cell, minlength=len(knots))
    sums = np.bincount(cell, wanted, minlength=len(knots))
    given = np.minimum(counts, 1.0)
    means = sums / np.maximum(counts, 1)
    slope = np.diff(np.eye(len(knots)), axis=0) / KNOT
    system = np.diag(given) + shear * slope.T @ slope
    fitted = np.linalg.solve(system, given * means)
    steps = np.diff(fitted).clip(-STEEPEST * KNOT, STEEPEST * KNOT)
    limited = np.concatenate([[0.0], np.cumsum(steps)])
    return limited + np.average(means - limited, weights=given)


def _covered(placed: Float[np.ndarray, "placed 3 2"], flat: Corners2) -> Bool[np.ndarray, " faces"]:
    """Which faces lie, in part, on charts that were placed before."""
    low = np.minimum(placed.min(axis=(0, 1)), flat.min(axis=(0, 1))) - 2 * CELL
    size = np.maximum(placed.max(axis=(0, 1)), flat.max(axis=(0, 1))) - low
    taken = np.zeros(np.ceil(size / CELL).astype(int)[::-1] + 2, np.uint8)
    for triangle in np.rint((placed - low) / CELL * 16).astype(np.int32):
        cv2.fillConvexPoly(taken, triangle, 1, shift=4)
    points = np.einsum("sc,fcd->fsd", INSIDE, (flat - low) / CELL)
    column, row = np.rint(points).astype(int).transpose(2, 0, 1)
    return taken[row, column].sum(axis=1) >= 2


def _stacked(
    flat: Corners2,
    placed: Bool[np.ndarray, " faces"],
    chosen: Bool[np.ndarray, " faces"],
    height: Float[np.ndarray, " faces"],
) -> Bool[np.ndarray, " faces"]:
    """Which of the large ``chosen`` faces share texels with others that are ``placed``.

    Of two that do, the one behind goes: on coarse meshes a wheel lies in front of a whole side.
    """
    stacked = np.zeros(len(flat), bool)
    area = np.abs(np.linalg.det(flat[:, 1:] - flat[:, :1])) / 2
    large = np.flatnonzero(chosen & (area > LARGE))
    if not len(large):
        return stacked
    cells = (flat - flat[placed].min(axis=(0, 1))) / CELL
    count = np.zeros(np.ceil(cells[placed].max(axis=(0, 1))).astype(int)[::-1] + 2, np.int16)
    for face in np.flatnonzero(placed):
        _count(count, cells[face], 1)
    for face in large[np.argsort(height[large])]:
        column, row = np.rint(MANY_INSIDE @ cells[face]).astype(int).T
        if (count[row, column] > 1).mean() > STACKED:
            stacked[face] = True
            _count(count, cells[face], -1)
    return stacked


def _count(
    count: Int[np.ndarray, "rows columns"], corners: Float[np.ndarray, "3 2"], step: int
) -> None:
    """Add ``step`` to the cells of a triangle."""
    low = np.floor(corners.min(axis=0)).astype(int)
    width, height = np.ceil(corners.max(axis=0)).astype(int) + 1 - low
    patch = np.zeros((height, width), np.uint8)
    cv2.fillConvexPoly(patch, np.rint((corners - low) * 16).astype(np.int32), 1, shift=4)
    count[low[1] : low[1] + height, low[0] : low[0] + width] += step * patch.astype(np.int16)
