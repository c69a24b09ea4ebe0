"""Shading normals: the file's where it has good ones, else made with a crease angle."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from cnca.vehicle.mesh.surface import face_crosses

CREASE = 40.0
"""Degrees between two faces from which the edge between them is sharp."""
LEAST_AGREEMENT = 0.05
"""A face's normals all have at least this much along its own, or all against it: otherwise their
mixture could vanish, or lie in the face, where the frame around it has no direction to start
from."""
MOST_NEIGHBOURS = 512
"""Faces around one point; where there are more, each has its own normal."""

Corners = Float[np.ndarray, "faces 3 3"]


def split_normals(
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    given: Float[np.ndarray, "vertices 3"] | None,
) -> tuple[Int[np.ndarray, " kept"], Int[np.ndarray, "faces 3"], Float[np.ndarray, "kept 3"]]:
    """Old index of each new vertex, faces of new vertices, and these vertices' unit normals.

    Args:
        given: the file's normals, or None.  They are kept except on faces where one is not a unit
            vector, or where they do not all clearly point to one side of the face.
    """
    corners = np.zeros((len(faces), 3, 3))
    bad = np.ones(len(faces), bool)
    if given is not None:
        lengths = np.linalg.norm(given, axis=1, keepdims=True)
        unit = np.abs(lengths[:, 0] - 1) < 0.01
        corners = (given / np.where(unit[:, None], lengths, 1.0))[faces]
        bad = ~unit[faces].all(axis=1) | ~_one_sided(corners, face_crosses(vertices, faces))
    if bad.any():
        corners[bad] = creased_normals(vertices, faces)[bad]
    keys = np.column_stack([faces.reshape(-1, 1), (corners * 1e4).round().reshape(-1, 3)])
    _, first, joined = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return faces.ravel()[first], joined.reshape(-1, 3), corners.reshape(-1, 3)[first]


def creased_normals(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> Corners:
    """At each corner the mean normal of the faces there that are within :data:`CREASE` of its own.

    Weighted by the faces' angles (Thürmer and Wüthrich 1998).  Each mean holds the face's own
    normal and nothing far from it, so that it never vanishes, not even on thin double sheets.
    """
    crosses = face_crosses(vertices, faces)
    own = crosses / np.maximum(np.linalg.norm(crosses, axis=1, keepdims=True), 1e-300)
    place = np.unique(vertices, axis=0, return_inverse=True)[1].ravel()[faces].ravel()
    order = np.argsort(place, kind="stable")
    starts = np.flatnonzero(np.diff(place[order], prepend=-1))
    sizes = np.diff(np.append(starts, len(order)))
    face = np.repeat(np.arange(len(faces)), 3)
    weighted = own[face] * _angles(vertices[faces]).ravel()[:, None]
    means = own[face]
    for size in np.unique(sizes[(sizes > 1) & (sizes <= MOST_NEIGHBOURS)]):
        # All points with equally many faces at once, in portions that fit into memory.
        groups = starts[sizes == size][:, None] + np.arange(size)
        for some in np.array_split(groups, max(1, len(groups) * int(size) ** 2 // 4_000_000)):
            corner = order[some]
            normals = own[face[corner]]
            near = normals @ normals.transpose(0, 2, 1) >= np.cos(np.radians(CREASE))
            means[corner] = near.astype(float) @ weighted[corner]
    lengths = np.linalg.norm(means, axis=1, keepdims=True)
    return np.where(lengths > 1e-12, means / np.maximum(lengths, 1e-12), own[face]).reshape(
        -1, 3, 3
    )


def _angles(triangles: Corners) -> Float[np.ndarray, "faces 3"]:
    """The angle of each corner in radians."""
    a = np.roll(triangles, -1, axis=1) - triangles
    b = np.roll(triangles, 1, axis=1) - triangles
    lengths = np.linalg.norm(a, axis=2) * np.linalg.norm(b, axis=2)
    return np.arccos(((a * b).sum(axis=2) / np.maximum(lengths, 1e-300)).clip(-1, 1))


def _one_sided(
    corners: Corners, crosses: Float[np.ndarray, "faces 3"]
) -> Bool[np.ndarray, " faces"]:
    """Whether a face's three normals lie on one side of it, with some distance to its plane."""
    lengths = np.linalg.norm(crosses, axis=1)
    along = np.einsum("fkc,fc->fk", corners, crosses) / np.maximum(lengths, 1e-300)[:, None]
    return (along.min(axis=1) > LEAST_AGREEMENT) | (along.max(axis=1) < -LEAST_AGREEMENT)
