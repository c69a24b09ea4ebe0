"""Which texels of a UV atlas belong to painted panels."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool

from cnca.core.errors import MeshError
from cnca.vehicle.model import Vehicle

SUBTEXEL_BITS = 4
"""Fixed-point precision with which the triangles' corners are drawn."""


def pad_mask(
    mask: Bool[np.ndarray, "size size"], vehicle: Vehicle, padding: int
) -> Bool[np.ndarray, "size size"]:
    """Let a square mask reach ``padding`` texels beyond the charts, into texels of no chart.

    Filtering at a chart's border then reads paint where the chart is paint.  Texels of other
    charts keep what the mask says.
    """
    from scipy.ndimage import distance_transform_edt  # slow to import, and few scenes need it

    used = paint_mask(vehicle, len(mask), padding=0)
    distance, nearest = distance_transform_edt(~used, return_indices=True)
    return np.where(distance <= padding, mask[tuple(nearest)], mask)


def paint_mask(vehicle: Vehicle, size: int, padding: int = 2) -> Bool[np.ndarray, "size size"]:
    """Return the texels of a ``size``² texture that the paint shows; row 0 is v = 1.

    ``padding`` texels around every chart count as paint too, because filtering reads them.
    Raises :class:`MeshError` where a painted part has no texture coordinates.
    """
    mask = np.zeros((size, size), np.uint8)
    for part in vehicle.parts:
        if part.material != "paint":
            continue
        if part.uvs is None:
            raise MeshError(
                f"{vehicle.name}: painted part '{part.name}' has no texture coordinates; "
                "give it an atlas"
            )
        # A texel's centre has integer coordinates in OpenCV, half-integer ones in UV.
        corners = part.uvs * (size, -size) + (-0.5, size - 0.5)
        fixed = np.rint(corners * 2**SUBTEXEL_BITS).astype(np.int32)
        for triangle in fixed[part.faces]:
            cv2.fillConvexPoly(mask, triangle, 1, shift=SUBTEXEL_BITS)
    if padding > 0:
        mask = cv2.dilate(mask, np.ones((2 * padding + 1, 2 * padding + 1), np.uint8))
    return mask.astype(bool)
