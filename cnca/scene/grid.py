"""The grid of a data set: every pose in every weather in every preset color.

As in the paper's data sets there are 16 weathers, four sun altitudes times four fog densities; a
scene that varies no fog has four sun azimuths instead.  The paper names neither its poses nor its
colors: our poses are spread evenly over the scene's ranges, our colors are ones cars are sold in.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from cnca.scene.cameras import View, orbit_view
from cnca.scene.schema import Scene
from cnca.scene.weather import Fog, Weather

COLOURS = {
    "white": (0.92, 0.92, 0.92),
    "silver": (0.78, 0.79, 0.80),
    "grey": (0.45, 0.46, 0.48),
    "black": (0.06, 0.06, 0.07),
    "red": (0.60, 0.05, 0.06),
    "blue": (0.08, 0.16, 0.45),
    "green": (0.05, 0.25, 0.16),
    "beige": (0.78, 0.70, 0.55),
    "yellow": (0.90, 0.72, 0.05),
    "orange": (0.85, 0.35, 0.05),
}
"""Name → sRGB."""
AZIMUTHS, ELEVATIONS, DISTANCES = 24, 4, 3
LEVELS = 4
"""Sun altitudes, and fog densities or sun azimuths."""
SHARING = 5
"""Consecutive colors that share one pose and weather, so that renderers may keep its background."""


@dataclass(frozen=True)
class Setting:
    """What one picture of the grid shows."""

    azimuth: float
    """Degrees counter-clockwise from the vehicle's front."""
    elevation: float
    """Degrees above the horizon."""
    distance: float
    """Metres from the vehicle's middle."""
    view: View
    weather: Weather
    colour: str
    """A key of :data:`COLOURS`."""


class Grid:
    """All settings of a scene, in an order in which every stretch is evenly spread."""

    def __init__(self, scene: Scene) -> None:
        ranges, image = scene.variation, scene.image
        # A full turn's end is its beginning: azimuths leave it out.
        azimuths = np.linspace(*ranges.azimuth, AZIMUTHS, endpoint=False)
        elevations = np.linspace(*ranges.elevation, ELEVATIONS)
        distances = np.linspace(*ranges.distance, DISTANCES)
        self._poses = [(a, e, d) for a in azimuths for e in elevations for d in distances]
        self._view = partial(orbit_view, fov=ranges.fov, width=image.width, height=image.height)
        self.weathers = _weathers(scene)
        self._colours = list(COLOURS)
        self._cells = len(self) // SHARING
        self._stride = _coprime_near(self._cells * (math.sqrt(5) - 1) / 2, self._cells)

    def __len__(self) -> int:
        return len(self._poses) * len(self.weathers) * len(self._colours)

    def __getitem__(self, index: int) -> Setting:
        """Setting number ``index``: multiples of the golden ratio of all cells, each cell once."""
        if not 0 <= index < len(self):
            raise IndexError(f"picture {index}: the grid has {len(self)}")
        turn, colour = divmod(index, SHARING)
        cell = turn * self._stride % self._cells
        cell, pose = divmod(cell, len(self._poses))
        part, weather = divmod(cell, len(self.weathers))
        colour += part * SHARING
        azimuth, elevation, distance = (float(x) for x in self._poses[pose])
        view = self._view(azimuth, elevation, distance)
        name = self._colours[colour]
        return Setting(azimuth, elevation, distance, view, self.weathers[weather], name)


def _weathers(scene: Scene) -> list[Weather]:
    ranges, scene_weather = scene.variation, scene.weather()
    altitudes = np.linspace(*ranges.sun_altitude, LEVELS).tolist()
    if ranges.visibility is None:
        azimuths = np.linspace(*ranges.sun_azimuth, LEVELS, endpoint=False).tolist()
        return [scene_weather.turned(h, a) for h in altitudes for a in azimuths]
    fog = scene_weather.fog or Fog(visibility=1.0)
    low, high = ranges.visibility
    # Evenly spread in extinction, since that is what dims a picture.
    visibilities = (1 / np.linspace(1 / high, 1 / low, LEVELS)).tolist()
    fogs = [replace(fog, visibility=visibility) for visibility in visibilities]
    suns = [scene_weather.turned(h, scene_weather.sun_azimuth) for h in altitudes]
    return [replace(weather, fog=f) for weather in suns for f in fogs]


def _coprime_near(value: float, count: int) -> int:
    """The number nearest to ``value`` whose multiples meet all of ``count`` cells."""
    nearest = sorted(range(1, count), key=lambda n: abs(n - value))
    return next((n for n in nearest if math.gcd(n, count) == 1), 1)
