"""How large road vehicles are, and the unit of a file that makes one of that size."""

from __future__ import annotations

import numpy as np

CAR = "car"
"""The label of what has the length of a car."""
CAR_LENGTH = (3.0, 6.0)
"""Metres."""
LONGEST = 18.75
"""Metres: the longest road vehicle (European directive 96/53/EC, annex I)."""
SHORTEST = 2.0
WIDTH, HEIGHT = (0.8, 3.2), (0.8, 4.5)
"""Metres, of road vehicles, including mirrors and what a truck carries."""
USUAL_LENGTH = {"bus": 12.0, "truck": 8.0}
"""Metres; all else has the length of a car."""
USUAL_CAR = 4.5
UNITS = {"metres": 1.0, "millimetres": 0.001, "centimetres": 0.01, "inches": 0.0254, "feet": 0.3048}

Size = tuple[float, float, float]
"""Length, width and height."""


def is_car(size: Size) -> bool:
    """Whether a size in metres is that of a car."""
    return CAR_LENGTH[0] <= size[0] <= CAR_LENGTH[1]


def is_long_vehicle(size: Size) -> bool:
    """Whether a size in metres is that of a bus or truck, from its width and height too."""
    length, width, height = size
    return (
        CAR_LENGTH[1] < length <= LONGEST
        and WIDTH[0] <= width <= WIDTH[1]
        and HEIGHT[0] <= height <= HEIGHT[1]
    )


def guess_scale(size: Size, label: str) -> tuple[float, str]:
    """Metres per unit of a file, and the unit's name, for a vehicle of ``size`` in units.

    Units that make a car of it come first, then those that make a bus or truck; where there is
    none, the scale that gives the vehicle the usual length of what ``label`` says.
    """
    usual = USUAL_LENGTH.get(label, USUAL_CAR)
    for fits in (is_car, is_long_vehicle):
        fitting = [
            (abs(np.log(size[0] * scale / usual)), scale, name)
            for name, scale in UNITS.items()
            if fits(_scaled(size, scale))
        ]
        if fitting:
            return min(fitting)[1:]
    return float(f"{usual / size[0]:.3g}"), f"a {label} of {usual:g} m"


def _scaled(size: Size, scale: float) -> Size:
    return size[0] * scale, size[1] * scale, size[2] * scale
