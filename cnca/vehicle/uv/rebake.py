"""Textures carried over from one UV layout to another."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import distance_transform_edt

Corners = Float[np.ndarray, "faces 3 2"]


def rebake(
    picture: Float[np.ndarray, "height width *channels"], old: Corners, new: Corners, size: int
) -> Float[np.ndarray, "size size *channels"]:
    """Paint what ``picture`` shows on each face at ``old`` where the face lies in ``new``.

    Texels of no face take the value of the nearest texel that has one, so filters see no seam.
    """
    owner = face_of_texels(new, size)
    row, column = np.nonzero(owner >= 0)
    face = owner[row, column]
    point = np.stack([(column + 0.5) / size, 1 - (row + 0.5) / size], axis=1)
    edges = new[face, 1:] - new[face, :1]
    share = np.linalg.solve(edges.transpose(0, 2, 1), (point - new[face, 0])[..., None])[..., 0]
    # Texels on a border have their centre just outside: look up the nearest point of the face.
    share = share.clip(0, 1) / np.maximum(share.clip(0, 1).sum(axis=1, keepdims=True), 1)
    at = old[face, 0] + np.einsum("fc,fcd->fd", share, old[face, 1:] - old[face, :1])
    height, width = picture.shape[:2]
    where = np.zeros((size, size, 2), np.float32)
    where[row, column] = at * (width, -height) + (-0.5, height - 0.5)
    baked = cv2.remap(
        picture.astype(np.float32),
        where,
        None,
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    nearest = distance_transform_edt(owner < 0, return_distances=False, return_indices=True)
    return baked[tuple(nearest)]


def face_of_texels(corners: Corners, size: int) -> Int[np.ndarray, "size size"]:
    """The face that each texel shows, −1 for none; faces without area in the texture show none."""
    owner = np.full((size, size), -1, np.int32)
    area = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
    fixed = np.rint((corners * (size, -size) + (-0.5, size - 0.5)) * 16).astype(np.int32)
    for face in np.flatnonzero(area > 1e-12):
        cv2.fillConvexPoly(owner, fixed[face], int(face), shift=4)
    return owner


def shown_in(
    mask: Bool[np.ndarray, "height width"], corners: Corners
) -> Bool[np.ndarray, " faces"]:
    """Which faces lie, by the middle of their texture, where ``mask`` holds."""
    height, width = mask.shape
    middle = corners.mean(axis=1) * (width, -height) + (0, height)
    column, row = middle.astype(int).clip(0, (width - 1, height - 1)).T
    return mask[row, column]
