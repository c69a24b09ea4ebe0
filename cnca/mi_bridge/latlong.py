"""Latitude–longitude maps as textures that are filtered correctly across φ = 0."""

from __future__ import annotations

import numpy as np

from cnca.mi_bridge.variant import dr, mi


def direction_uv(d: mi.Vector3f, columns: int) -> mi.Point2f:
    """Position in a latitude–longitude map that has one wrapped column on either side."""
    phi = dr.atan2(d.y, d.x)
    phi = dr.select(phi < 0, phi + dr.two_pi, phi)
    u = (phi * (columns / (2 * np.pi)) + 1) / (columns + 2)
    return mi.Point2f(u, dr.safe_acos(d.z) * dr.inv_pi)


def wrap_columns(grid: np.ndarray) -> mi.TensorXf:
    """Repeat the first and last column so that linear filtering is correct across φ = 0."""
    wrapped = np.concatenate([grid[..., -1:, :], grid, grid[..., :1, :]], axis=-2)
    return mi.TensorXf(np.ascontiguousarray(wrapped, dtype=np.float32))
