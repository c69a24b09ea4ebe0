"""Polygons, convex or not, cut into triangles that cover the same area."""

from __future__ import annotations

import mapbox_earcut
import numpy as np
from jaxtyping import Float, Int


def triangles_of(
    sizes: Int[np.ndarray, " polygons"], points: Float[np.ndarray, "corners 3"]
) -> Int[np.ndarray, "triangles 3"]:
    """Corners of the triangles of all polygons, one after the other.

    ``sizes`` are the polygons' numbers of corners: fewer than three make none; ``points`` are
    where the corners lie.
    """
    starts = np.cumsum(sizes) - sizes
    triangles = [starts[sizes == 3][:, None] + np.arange(3)]
    triangles.append(_quads(starts[sizes == 4][:, None] + np.arange(4), points))
    for start, size in zip(starts[sizes > 4], sizes[sizes > 4], strict=True):
        triangles.append(start + triangulate(points[start : start + size]))
    return np.concatenate(triangles)


def triangulate(points: Float[np.ndarray, "corners 3"]) -> Int[np.ndarray, "triangles 3"]:
    """Corners of the triangles of a polygon, which run around as the polygon does.

    A convex polygon becomes the fan of its first corner; any other one is cut by its ears (Meisters
    1975, as in Mapbox's earcut) in the plane of its Newell normal.  A polygon without area, or one
    with a corner that is not a number, is taken as a fan.
    """
    fan = np.array([(0, i, i + 1) for i in range(1, len(points) - 1)], np.int64).reshape(-1, 3)
    if len(points) == 3:
        return fan
    flat = _in_plane(points)
    if flat is None or _is_convex(flat):
        return fan
    ends = np.array([len(flat)], np.uint32)
    ears = mapbox_earcut.triangulate_float64(flat, ends).reshape(-1, 3).astype(np.int64)
    if not len(ears):
        return fan
    a, b, c = (flat[ears[:, i]] for i in range(3))
    clockwise = _cross(b - a, c - a) < 0
    ears[clockwise] = ears[clockwise][:, ::-1]
    return ears


def _in_plane(points: Float[np.ndarray, "corners 3"]) -> Float[np.ndarray, "corners 2"] | None:
    """Counter-clockwise in the plane in which the polygon has most area; None without any."""
    with np.errstate(invalid="ignore", over="ignore"):
        moved = points - points[0]
        normal = np.cross(moved, np.roll(moved, -1, axis=0)).sum(axis=0)
        length = float(np.linalg.norm(normal))
    if not np.isfinite(length) or length == 0:
        return None
    normal /= length
    u = np.cross(np.eye(3)[np.abs(normal).argmin()], normal)
    u /= np.linalg.norm(u)
    return np.ascontiguousarray(moved @ np.stack([u, np.cross(normal, u)]).T)


def _is_convex(flat: Float[np.ndarray, "corners 2"]) -> bool:
    """Whether a counter-clockwise polygon only turns left, and once around."""
    edges = np.roll(flat, -1, axis=0) - flat
    edges = edges[(edges != 0).any(axis=1)]
    following = np.roll(edges, -1, axis=0)
    turns = np.arctan2(_cross(edges, following), (edges * following).sum(axis=1))
    return bool((turns > -1e-6).all() and turns.sum() < 3 * np.pi)


def _cross(a: Float[np.ndarray, "n 2"], b: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _quads(
    quads: Int[np.ndarray, "quads 4"], points: Float[np.ndarray, "corners 3"]
) -> Int[np.ndarray, "triangles 3"]:
    """Cut along the diagonal that lies inside; along the first one where both do."""
    a, b, c, d = (points[quads[:, i]] for i in range(4))
    normal = np.cross(c - a, d - b)
    first, second = np.cross(b - a, c - a), np.cross(c - a, d - a)
    inside = ((first * normal).sum(axis=1) >= 0) & ((second * normal).sum(axis=1) >= 0)
    quads = np.where(inside[:, None], quads, np.roll(quads, -1, axis=1))
    return quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
