"""Where the next rays of a picture go: to the vehicle first, and there to where the noise is.

The steps n of each pixel that make the mean of v / n as small as is wanted, with the fewest rays,
are proportional to √v (Neyman 1934), v the variance of one step.  A few rays know it badly, and a
pixel that has met no bright path yet looks quiet: v is the mean of what its neighborhood and all
pixels say.  Judged by its own noise alone, a pixel would end where its streams agree by chance, and
what they say of the error afterwards would be 15 % too small.
"""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch.nn import functional

from cnca.jobs.accuracy.streams import Squares

NEIGHBORHOOD = 5
"""Pixels per side."""
MOST_UNEVEN = 4.0
"""Steps of a pixel over the mean."""
GOLDEN = 0.6180339887498949
"""Its multiples modulo 1 spread evenly: they round parts of steps."""


def variance(
    noise: Squares, steps: Int[np.ndarray, " pixels"], group: Bool[np.ndarray, "h w"]
) -> Squares:
    """Of one step at each pixel of the group, from the noise of the mean of its steps.

    Args:
        group: where in the picture these pixels are.
    """
    picture = np.zeros(group.shape)
    picture[group] = noise * steps
    around = _box(picture)[group] / np.maximum(_box(group.astype(float))[group], 1e-9)
    return np.asarray((around + around.mean()) / 2)


def wanted(
    v: Squares, steps: Int[np.ndarray, " pixels"], goal: float
) -> Float[np.ndarray, " pixels"]:
    """Total steps that bring mean(v / steps) down to the goal; none are taken back."""
    low, high = 0.0, float(np.sqrt(v).mean() / goal + steps.max() / max(np.sqrt(v).min(), 1e-12))
    for _ in range(60):
        middle = (low + high) / 2
        if np.mean(v / _at_least(steps, middle * np.sqrt(v))) > goal:
            low = middle
        else:
            high = middle
    return _at_least(steps, high * np.sqrt(v))


def whole(steps: Float[np.ndarray, " pixels"], turn: int) -> Int[np.ndarray, " pixels"]:
    """Steps rounded up or down, so that their mean stays."""
    dither = (np.arange(len(steps)) * GOLDEN + turn * GOLDEN**2) % 1
    return np.asarray(np.floor(steps + dither), dtype=np.int64)


def _at_least(
    steps: Int[np.ndarray, " pixels"], n: Float[np.ndarray, " pixels"]
) -> Float[np.ndarray, " pixels"]:
    return np.maximum(steps, np.minimum(n, MOST_UNEVEN * n.mean()))


def _box(picture: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    """Sum over the neighborhood."""
    batch = torch.from_numpy(picture)[None, None].double()
    half = NEIGHBORHOOD // 2
    total = functional.avg_pool2d(batch, NEIGHBORHOOD, 1, half) * NEIGHBORHOOD**2
    return np.asarray(total[0, 0].numpy())
