"""Views sorted by what they differ in: azimuth, elevation, distance, fog and sun."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cnca.judge.evaluate import Shots
from cnca.scene.cameras import orbit_of

AXES = ("elevation", "azimuth", "distance", "visibility", "sun")
"""In degrees, degrees, metres, metres (infinite in clear air) and degrees above the horizon."""
SECTORS = 8
MOST_LEVELS = 6
"""An axis with more different values is cut into :data:`PARTS` of equally many views."""
PARTS = 4


@dataclass(frozen=True)
class Section:
    """Views that are alike in one axis."""

    label: str
    place: float
    """The middle of their values; infinite for clear air."""
    views: list[int]


def parameters(shots: Shots) -> list[dict[str, float]]:
    """The value of each axis for every view, in the order of the shots."""
    table = []
    for views, weather in zip(shots.views, shots.weathers, strict=True):
        visibility = weather.fog.visibility if weather.fog else math.inf
        for view in views:
            azimuth, elevation, distance = orbit_of(view)
            values = elevation, azimuth, distance, visibility, weather.sun_altitude
            table.append({name: round(v, 3) for name, v in zip(AXES, values, strict=True)})
    return table


def sections(table: Sequence[dict[str, float]], axis: str) -> list[Section]:
    """The views of each level of an axis, in ascending order; all in one where they do not differ.

    Azimuths are put into eight sectors, the first around 0°, the vehicle's front.
    """
    values = np.array([row[axis] for row in table])
    if axis == "azimuth":
        width = 360 / SECTORS
        sector = np.rint(values / width).astype(int) % SECTORS
        return [
            Section(f"{k * width:g}°", k * width, np.flatnonzero(sector == k).tolist())
            for k in np.unique(sector)
        ]
    levels = np.unique(values)
    if len(levels) <= MOST_LEVELS:
        return [
            Section(_label(v, v), float(v), np.flatnonzero(values == v).tolist()) for v in levels
        ]
    ranks = np.argsort(np.argsort(values, kind="stable"), kind="stable")
    part = ranks * PARTS // len(values)
    divided = []
    for k in np.unique(part):
        inside = values[part == k]
        low, high = float(inside.min()), float(inside.max())
        divided.append(
            Section(_label(low, high), float(np.median(inside)), np.flatnonzero(part == k).tolist())
        )
    return divided


def _label(low: float, high: float) -> str:
    if math.isinf(low):
        return "clear"
    if low == high:
        return f"{low:.4g}"
    return f"{low:.3g}–{'clear' if math.isinf(high) else f'{high:.3g}'}"
