"""The painted outside as flat panels of true size: what is cut out of paper to cover a model.

A panel is a connected piece of one side of the car.  It is laid flat as rigidly as possible
(Liu, Zhang, Xu, Gotsman and Gortler, "A Local/Global Approach to Mesh Parameterization", 2008,
ARAP), from its projection onto the side; what is curved both ways must stretch a little.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_matrix, csc_matrix
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import factorized

from cnca.core.errors import MeshError
from cnca.vehicle.mesh.surface import face_crosses
from cnca.vehicle.model import Vehicle
from cnca.vehicle.uv.skin import Skin
from cnca.vehicle.uv.unfold import SIDES, sides, unfold

LEAST_AREA = 0.01
"""Square metres below which a piece is left out: a stamp of 8 mm at 1:12."""
ROUNDS = 30
LEAST_WEIGHT = 1e-3
"""Cotangents of obtuse corners are negative, and would let triangles fold over."""

Corners2 = Float[np.ndarray, "faces 3 2"]


@dataclass(frozen=True)
class Panel:
    """A piece of the outside, laid flat; metres, u and v as on the sides of :mod:`unfold`."""

    name: str
    """Its side and a number, the largest first, such as "left 1"."""
    faces: Int[np.ndarray, " faces"]
    """Indices into the vehicle's :class:`Skin`."""
    corners: Corners2
    """The lowest u and v are 0."""
    stretch: float
    """Largest change of length, as a share of it, in 95 % of the area."""

    @property
    def size(self) -> Float[np.ndarray, "2"]:
        """Width and height in metres."""
        return self.corners.max(axis=(0, 1))


def develop(
    vehicle: Vehicle, painted: Bool[np.ndarray, " faces"] | None = None
) -> tuple[list[Panel], float]:
    """Return the panels, side by side, and their share of the painted area seen from outside.

    Args:
        painted: faces that the camouflage covers, where a mask says so; None for all.

    Raises:
        MeshError: nothing painted is seen from outside.
    """
    skin = Skin.of(vehicle)
    chosen = np.arange(len(skin.faces)) if painted is None else np.flatnonzero(painted)
    panes = [p.vertices[p.faces] for p in vehicle.parts if p.material == "glass"]
    glass = np.concatenate([np.zeros((0, 3, 3)), *panes])
    faces = skin.faces[chosen]
    outside = unfold(skin.vertices, faces, glass)[0]
    if not outside.any():
        raise MeshError(f"{vehicle.name}: no painted face can be seen from outside")
    side = sides(skin.vertices, faces)
    area = np.linalg.norm(face_crosses(skin.vertices, faces), axis=1) / 2
    panels, area_laid_out = [], 0.0
    for index, direction in enumerate(SIDES):
        mine = np.flatnonzero(outside & (side == index))
        pieces = [mine[piece] for piece in _connected(skin.vertices, faces[mine])]
        pieces = [piece for piece in pieces if area[piece].sum() >= LEAST_AREA]
        pieces.sort(key=lambda piece: -area[piece].sum())
        for number, piece in enumerate(pieces, start=1):
            triangles = skin.vertices[faces[piece]]
            flat, stretch = flatten(triangles, np.array([direction.u, direction.v], float))
            panels.append(Panel(f"{direction.name} {number}", chosen[piece], flat, stretch))
            area_laid_out += area[piece].sum()
    return panels, float(area_laid_out / area[outside].sum())


def flatten(
    triangles: Float[np.ndarray, "faces 3 3"], axes: Float[np.ndarray, "2 3"]
) -> tuple[Corners2, float]:
    """Lay triangles flat as rigidly as possible, turned as their projection onto ``axes`` is.

    Returns their corners, from (0, 0), and the largest change of length in 95 % of the area.
    """
    keys = (triangles * 1e5).round().reshape(-1, 3)
    places, first, joined = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    faces = joined.reshape(-1, 3)
    plane = _own_planes(triangles)
    edges = plane[:, [1, 2, 0]] - plane  # edge k runs from corner k to the next
    weights = _cotangents(plane)[:, [2, 0, 1]]  # of the corner opposite to it
    i, j, w = faces.ravel(), faces[:, [1, 2, 0]].ravel(), weights.ravel()
    count = len(places)
    pairs = coo_matrix((w, (i, j)), shape=(count, count))
    pairs = pairs + pairs.T
    degree = np.asarray(pairs.sum(axis=1)).ravel()
    degree[0] += 1.0  # one vertex stays where it is, or the whole would float
    solve = factorized(csc_matrix(coo_matrix((degree, (range(count),) * 2)) - pairs))
    flat = triangles.reshape(-1, 3)[first] @ axes.T
    start = flat.copy()
    for _ in range(ROUNDS):
        turned = np.einsum("fab,fkb->fka", _rotations(flat[faces], edges, weights), edges)
        pull = np.zeros((count, 2))
        np.add.at(pull, i, -(w[:, None] * turned.reshape(-1, 2)))
        np.add.at(pull, j, w[:, None] * turned.reshape(-1, 2))
        pull[0] += flat[0]
        flat = np.stack([solve(pull[:, 0]), solve(pull[:, 1])], axis=1)
    flat = _turned_back(flat, start)
    flat -= flat.min(axis=0)
    return flat[faces], _stretch(plane, flat[faces])


def _connected(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> list[Int[np.ndarray, " some"]]:
    """Indices of the faces of each piece that is connected by shared places."""
    places = np.unique((vertices[faces] * 1e5).round().reshape(-1, 3), axis=0, return_inverse=True)
    corners = places[1].reshape(-1, 3)
    i, j = corners[:, [0, 1]].ravel(), corners[:, [1, 2]].ravel()
    count = len(places[0])
    label = connected_components(coo_matrix((np.ones(len(i)), (i, j)), shape=(count, count)))[1]
    own = label[corners[:, 0]]
    return [np.flatnonzero(own == one) for one in np.unique(own)]


def _own_planes(triangles: Float[np.ndarray, "faces 3 3"]) -> Corners2:
    """Each triangle in its own plane, its first corner at (0, 0), the second on the first axis."""
    a, b = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    base = np.maximum(np.linalg.norm(a, axis=1), 1e-9)
    along = (a * b).sum(axis=1) / base
    across = np.linalg.norm(np.cross(a, b), axis=1) / base
    zero = np.zeros_like(base)
    return np.stack([zero, zero, base, zero, along, across], axis=1).reshape(-1, 3, 2)


def _cotangents(own: Corners2) -> Float[np.ndarray, "faces 3"]:
    """The cotangent of each corner's angle, within bounds."""
    a, b = own[:, [1, 2, 0]] - own, own[:, [2, 0, 1]] - own
    cross = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    cotangents = (a * b).sum(axis=2) / np.maximum(np.abs(cross), 1e-12)
    return cotangents.clip(LEAST_WEIGHT, 1 / LEAST_WEIGHT)


def _rotations(
    now: Corners2, edges: Corners2, weights: Float[np.ndarray, "faces 3"]
) -> Float[np.ndarray, "faces 2 2"]:
    """The rotation that brings each triangle's own edges nearest to what they are now."""
    moved = now[:, [1, 2, 0]] - now
    s = np.einsum("fk,fka,fkb->fab", weights, moved, edges)
    angle = np.arctan2(s[:, 1, 0] - s[:, 0, 1], s[:, 0, 0] + s[:, 1, 1])
    c, n = np.cos(angle), np.sin(angle)
    return np.stack([c, -n, n, c], axis=1).reshape(-1, 2, 2)


def _turned_back(
    flat: Float[np.ndarray, "places 2"], start: Float[np.ndarray, "places 2"]
) -> Float[np.ndarray, "places 2"]:
    """``flat`` turned as a whole to lie as ``start`` does (Kabsch, in the plane)."""
    s = (start - start.mean(axis=0)).T @ (flat - flat.mean(axis=0))
    angle = np.arctan2(s[1, 0] - s[0, 1], s[0, 0] + s[1, 1])
    c, n = np.cos(angle), np.sin(angle)
    return flat @ np.array([[c, -n], [n, c]]).T


def _stretch(own: Corners2, flat: Corners2) -> float:
    area = own[:, 1, 0] * own[:, 2, 1] / 2
    good = area > 1e-10
    a, b = (x[good, 1:] - x[good, :1] for x in (own, flat))
    change = np.abs(np.linalg.svd(np.linalg.solve(a, b), compute_uv=False) - 1).max(axis=1)
    order = np.argsort(change)
    share = np.cumsum(area[good][order]) / area[good].sum()
    return float(change[order][np.searchsorted(share, 0.95)])
