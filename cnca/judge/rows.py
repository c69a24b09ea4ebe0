"""Names of the rows of an evaluation; nothing here needs torch."""

from __future__ import annotations

NORMAL = "normal"
"""The vehicle's own paint."""
CONTROLS = ("uniform", "random", "prompt", "shuffled", "mirrored", "mean")
"""What camouflages must prove themselves against; see :mod:`cnca.judge.candidates`."""
RESERVED = (NORMAL, "uniform", "random", "prompt", "photograph", "total")
"""Names that no camouflage may have."""

IGNORE, COUNT = "ignore", "count"
OTHERS = (IGNORE, COUNT)
"""What becomes of other vehicles in the pictures: their detections are left out, or they are
objects to be found, too."""
