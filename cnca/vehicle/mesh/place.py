"""Where a vehicle stands in its file: cameras look at the origin."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

AWAY = 0.35
"""Share of the length, or of the width, by which the middle may miss the origin: origins on the
rear axle (0.3), as robots have them, stay there."""


def misplaced(low: Float[np.ndarray, "3"], high: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """The middle of the ground plan where that is away from the origin; else zeros.

    ``low`` and ``high`` are the corners of the vehicle's box in our axes.
    """
    middle = (low + high) / 2 * (1, 1, 0)
    away = np.abs(middle) > AWAY * (high - low)
    return middle if away[:2].any() else np.zeros(3)
