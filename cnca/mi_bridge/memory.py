"""How many rays are traced at once: pictures of more are the mean of parts."""

from __future__ import annotations

import os
import re

import numpy as np

from cnca.core.errors import BackendError

BUDGET = "CNCA_MEMORY_BUDGET"
"""Environment variable with the memory that rays may take; ``cnca --memory-budget`` sets it."""

BYTES = 50
"""Most that a ray takes, forward or backward: where a pixel has several, 14 each."""

MOST_RAYS = 2**24
"""Rays at once without a budget."""

UNITS = {"": 1, "KiB": 2**10, "MiB": 2**20, "GiB": 2**30, "KB": 10**3, "MB": 10**6, "GB": 10**9}


def samples_at_once(pixels: int, most_rays: int | None = None) -> int:
    """Rays per pixel of one part of a picture; ``most_rays`` may ask for less than there is room.

    Raises:
        BackendError: the budget is not a size, or has no room for one ray per pixel.
    """
    budget = os.environ.get(BUDGET)
    room = _bytes(budget) // BYTES if budget else MOST_RAYS
    if budget and room < pixels:
        raise BackendError(
            f"--memory-budget {budget}: one ray for each of {pixels} pixels takes "
            f"{pixels * BYTES / 2**20:.1f} MiB; give that, or smaller or fewer pictures at once"
        )
    return max(min(most_rays or room, room) // pixels, 1)


def refuse_too_many(rays: int) -> None:
    """Raise BackendError where that many rays find no room: Dr.Jit would crash."""
    try:
        np.empty(rays * BYTES, np.uint8)  # takes addresses, no memory
    except MemoryError:
        raise BackendError(
            f"no memory for {rays} rays at once ({rays * BYTES / 2**20:.0f} MiB); "
            "such as cnca --memory-budget 100MiB … renders pictures in smaller parts"
        ) from None


def _bytes(size: str) -> int:
    found = re.fullmatch(r"(\d+(?:\.\d+)?) ?(\D*)", size)
    if not found or found[2] not in UNITS:
        raise BackendError(f"--memory-budget {size}: give a size such as 500MiB or 2GiB")
    return int(float(found[1]) * UNITS[found[2]])
