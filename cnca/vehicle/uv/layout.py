"""How good a UV layout is: charts, seams, stretch and use of the texture."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from cnca.vehicle.mesh.surface import face_crosses
from cnca.vehicle.uv.skin import Skin

ACROSS = 0.02
"""Metres from one chart's border over a panel gap to the next."""
APART = 3
"""A border is a seam if what lies across is this many times farther in the texture."""
SAMPLE = 0.01
"""Metres between the points at which borders are looked at."""
RASTER = 1024
"""Texels per side with which used area is measured."""


@dataclass(frozen=True)
class Layout:
    """Numbers of a layout, for the faces that count."""

    charts: int
    """Pieces that are connected in the texture."""
    seam_length: float
    """Metres of chart borders next to which (within 2 cm) the car goes on elsewhere in the
    texture; gaps between panels that lie side by side do not count."""
    stretch: float
    """L² stretch of Sander et al. 2001 over its smallest value for the same areas; 1 is none."""
    density_spread: float
    """Texels per metre: 95th over 5th percentile of the area."""
    used: float
    """Share of the texture that the faces cover."""
    overlap: float
    """Share of the faces' texture area that other faces cover too."""


def measure(skin: Skin, faces: Bool[np.ndarray, " faces"]) -> Layout:
    """Measure the layout of the chosen ``faces``."""
    triangles, corners = skin.vertices[skin.faces[faces]], skin.corners[faces]
    area = np.linalg.norm(face_crosses(skin.vertices, skin.faces[faces]), axis=1) / 2
    flat = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 2
    share = covered(corners)
    return Layout(
        charts=_charts(triangles, corners),
        seam_length=seam_length(triangles, corners, (area.sum() / max(flat.sum(), 1e-12)) ** 0.5),
        stretch=_stretch(triangles, corners, area, flat),
        density_spread=_spread(np.sqrt(flat / np.maximum(area, 1e-12)), area),
        used=share,
        overlap=max(0.0, 1 - share / max(flat.sum(), 1e-12)),
    )


def seam_length(
    triangles: Float[np.ndarray, "faces 3 3"],
    corners: Float[np.ndarray, "faces 3 2"],
    metres: float,
) -> float:
    """Metres of seams, each counted once; ``metres`` is the car's length per unit of texture."""
    (a, b), (s, t) = _borders(triangles, corners)
    length = np.linalg.norm(b - a, axis=1)
    count = np.ceil(length / SAMPLE).astype(int).clip(1)
    edge = np.repeat(np.arange(len(a)), count)
    within = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    f = ((within + 0.5) / count[edge])[:, None]
    points, flat = (1 - f) * a[edge] + f * b[edge], (1 - f) * s[edge] + f * t[edge]
    i, j = cKDTree(points).query_pairs(ACROSS, output_type="ndarray").reshape(-1, 2).T
    far = np.linalg.norm(flat[i] - flat[j], axis=1) * metres > APART * ACROSS
    seam = np.zeros(len(points), bool)
    seam[i[far]] = seam[j[far]] = True
    return float((length / count)[edge][seam].sum() / 2)  # a seam has a border on each side


def corner_keys(
    triangles: Float[np.ndarray, "faces 3 3"], corners: Float[np.ndarray, "faces 3 2"]
) -> Int[np.ndarray, "faces 3"]:
    """The same number where the places on the car (to 10 µm) and in the texture (to 10⁻⁶) agree."""
    keys = np.column_stack(
        [(triangles * 1e5).round().reshape(-1, 3), (corners * 1e6).round().reshape(-1, 2)]
    )
    return np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1, 3)


def _charts(
    triangles: Float[np.ndarray, "faces 3 3"], corners: Float[np.ndarray, "faces 3 2"]
) -> int:
    keys = corner_keys(triangles, corners)
    i, j = keys[:, [0, 1]].ravel(), keys[:, [1, 2]].ravel()
    count = keys.max() + 1
    return int(connected_components(coo_matrix((np.ones(len(i)), (i, j)), shape=(count, count)))[0])


def _borders(
    triangles: Float[np.ndarray, "faces 3 3"], corners: Float[np.ndarray, "faces 3 2"]
) -> tuple[np.ndarray, np.ndarray]:
    """Edges of one face only: ends on the car (2, edges, 3) and in the texture (2, edges, 2)."""
    keys = corner_keys(triangles, corners)
    ends = np.sort(keys[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, inverse, counts = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    single = counts[inverse.ravel()] == 1
    turned = [1, 2, 0]
    car, flat = (
        np.stack([values.reshape(-1, n), values[:, turned].reshape(-1, n)])[:, single]
        for values, n in ((triangles, 3), (corners, 2))
    )
    return car, flat


def _stretch(
    triangles: Float[np.ndarray, "faces 3 3"],
    corners: Float[np.ndarray, "faces 3 2"],
    area: Float[np.ndarray, " faces"],
    flat: Float[np.ndarray, " faces"],
) -> float:
    """Root mean square of the singular values of texture → car; without area it is infinite."""
    good = (flat > 1e-12) & (area > 1e-10)
    if not good.any():
        return float("inf")
    edges = triangles[good, 1:] - triangles[good, :1]
    jacobian = np.linalg.solve(corners[good, 1:] - corners[good, :1], edges)
    mean_square = (jacobian**2).sum(axis=(1, 2)) / 2
    area, flat = area[good], flat[good]
    return float(np.sqrt((area * mean_square).sum() / area.sum() * flat.sum() / area.sum()))


def _spread(density: Float[np.ndarray, " faces"], area: Float[np.ndarray, " faces"]) -> float:
    order = np.argsort(density)
    share = np.cumsum(area[order]) / area.sum()
    low, high = density[order][np.searchsorted(share, [0.05, 0.95])]
    return float(high / max(low, 1e-12))


def covered(corners: Float[np.ndarray, "faces 3 2"]) -> float:
    """Share of texel centres inside some face (OpenCV draws borders too, half a texel wide)."""
    canvas = np.zeros((4 * RASTER, 4 * RASTER), np.uint8)
    for triangle in np.rint(corners * 4 * RASTER * 16 - 8).astype(np.int32):
        cv2.fillConvexPoly(canvas, triangle, 1, shift=4)
    return float(cv2.resize(canvas, (RASTER, RASTER), interpolation=cv2.INTER_NEAREST).mean())
