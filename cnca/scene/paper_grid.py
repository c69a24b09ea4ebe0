"""The paper's test pictures: a grid of views and weathers, whole or a balanced sample of it.

The paper (section 4.1) tests on 8192 pictures: 16 weathers, "combining four sun altitudes and four
fog densities", and poses of different elevation, azimuth and distance.  It states these counts, no
values.  16 × 512 is 8192 for four elevations, 32 azimuths and four distances; the values here are
ours, fog as visibility instead of CARLA's fog density.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from cnca.core.errors import SceneError, did_you_mean
from cnca.scene.cameras import View, orbit_view
from cnca.scene.schema import Scene
from cnca.scene.weather import Fog, Weather


@dataclass(frozen=True)
class EvaluationGrid:
    """Every combination of these values; angles in degrees, lengths in metres."""

    sun_altitudes: tuple[float, ...]
    visibilities: tuple[float | None, ...]
    """None is clear air."""
    elevations: tuple[float, ...]
    azimuths: tuple[float, ...]
    distances: tuple[float, ...]

    @property
    def levels(self) -> tuple[int, int, int, int]:
        """How many weathers, elevations, azimuths and distances there are."""
        weathers = len(self.sun_altitudes) * len(self.visibilities)
        return weathers, len(self.elevations), len(self.azimuths), len(self.distances)


PRESETS = {
    "paper": EvaluationGrid(
        sun_altitudes=(15.0, 35.0, 55.0, 75.0),
        visibilities=(None, 500.0, 150.0, 60.0),
        elevations=(5.0, 15.0, 25.0, 35.0),
        azimuths=tuple(360 / 32 * k for k in range(32)),
        distances=(6.0, 9.0, 12.0, 15.0),
    )
}


def find_grid(name: str) -> EvaluationGrid:
    """The preset called ``name``; raises SceneError for another name."""
    if name not in PRESETS:
        hint = did_you_mean(name, PRESETS)
        raise SceneError(f"--grid {name}: unknown; there is {', '.join(PRESETS)}{hint}")
    return PRESETS[name]


def grid_shots(
    scene: Scene, grid: EvaluationGrid, count: int, *, seed: int
) -> tuple[list[list[View]], list[Weather]]:
    """Views by weather, and the weathers: ``count`` cells of the grid (see :func:`balanced_cells`).

    Sun azimuth, turbidity, the fog's height and droplets, field of view and picture size are the
    scene's; weathers without views are left out.
    """
    weathers = [
        _weather(scene, altitude, visibility)
        for altitude in grid.sun_altitudes
        for visibility in grid.visibilities
    ]
    views: list[list[View]] = [[] for _ in weathers]
    for weather, elevation, azimuth, distance in balanced_cells(grid.levels, count, seed).tolist():
        views[weather].append(
            orbit_view(
                grid.azimuths[azimuth],
                grid.elevations[elevation],
                grid.distances[distance],
                fov=scene.variation.fov,
                width=scene.image.width,
                height=scene.image.height,
            )
        )
    used = [k for k, drawn in enumerate(views) if drawn]
    return [views[k] for k in used], [weathers[k] for k in used]


def balanced_cells(levels: tuple[int, ...], count: int, seed: int) -> Int[np.ndarray, "count axes"]:
    """``count`` different cells in which the levels of each axis come equally often, ± 1.

    A Latin hypercube over the levels; a cell that occurs twice swaps its level of the last axis
    but one with another cell, where that makes two new ones.  Sorted; all cells where ``count`` is
    their number or more.
    """
    total = int(np.prod(levels))
    every = np.stack(np.unravel_index(np.arange(total), levels), axis=1)
    if count >= total:
        return every
    if count > total // 2:  # what is left out is as balanced as what is taken
        rest = balanced_cells(levels, total - count, seed)
        return np.delete(every, np.ravel_multi_index(tuple(rest.T), levels), axis=0)
    rng = np.random.default_rng(seed)
    cells = np.stack([_column(size, count, rng) for size in levels], axis=1)
    flat = np.ravel_multi_index(tuple(cells.T), levels)
    taken = np.bincount(flat, minlength=total)
    while (taken > 1).any():
        pair = [int(np.flatnonzero(taken[flat] > 1)[0]), int(rng.integers(count))]
        exchanged = cells[pair]
        exchanged[:, -2] = exchanged[::-1, -2]
        new = np.ravel_multi_index(tuple(exchanged.T), levels)
        if new[0] != new[1] and (taken[new] == 0).all():
            np.add.at(taken, flat[pair], -1)
            cells[pair], flat[pair] = exchanged, new
            taken[new] += 1
    return every[np.sort(flat)]


def _column(size: int, count: int, rng: np.random.Generator) -> Int[np.ndarray, " count"]:
    """Every level equally often, the odd ones at random, in random order."""
    whole = np.tile(np.arange(size), count // size)
    odd = rng.permutation(size)[: count % size]
    return rng.permutation(np.concatenate([whole, odd]))


def _weather(scene: Scene, altitude: float, visibility: float | None) -> Weather:
    scene_weather = scene.weather()
    fog = None
    if visibility is not None:
        fog = dataclasses.replace(scene_weather.fog or Fog(visibility), visibility=visibility)
    return dataclasses.replace(scene_weather.turned(altitude, scene_weather.sun_azimuth), fog=fog)
