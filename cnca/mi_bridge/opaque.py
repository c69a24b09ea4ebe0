"""Numbers that kernels read from memory, so that other values need no other kernel."""

from __future__ import annotations

import numpy as np

from cnca.mi_bridge.variant import dr, mi


def opaque_vector(values: np.ndarray) -> mi.Vector3f:
    """A vector that kernels read from memory, so that another value needs no other kernel."""
    vector = mi.Vector3f(*values.tolist())
    dr.make_opaque(vector)
    return vector


def opaque_float(value: float) -> mi.Float:
    """A number likewise."""
    return dr.opaque(mi.Float, value)
