"""Random scenes in which models are priced."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch

from cnca.scene.cameras import View, orbit_view
from cnca.scene.environment import sky_directions
from cnca.scene.schema import Scene, SkySection, WorldSection
from cnca.scene.weather import Fog, Weather
from cnca.world.builtin import BUILTIN_WORLDS
from cnca.world.builtin import build as build_world

SIZE = 64
"""Pixels per side, and texels."""
VEHICLES = ("sedan", "hatchback", "suv", "van", "pickup")
FARTHEST = 9.0
"""Metres from which a vehicle among houses is seen."""
MAP_ROWS = 64
LAMP_RADIUS = 4.0
"""Degrees, of those in a random sky's map."""


@dataclass(frozen=True)
class Case:
    """One picture of one random scene."""

    scene: Scene
    albedo: torch.Tensor
    view: View
    weather: Weather


def random_case(seed: int, effect: str | None = None, folder: Path | None = None) -> Case:
    """Vehicle, paint, ground, camera and weather at random; two of five in fog, one in dusk.

    In one of four the windows are clear.  What only few scenes hold (:data:`SHOWING`) is in it
    where ``effect`` asks for it.

    Args:
        folder: where files that the scene names are written; only a measured sky has one.
    """
    rng = np.random.default_rng(seed)
    vehicle: dict[str, object] = {"mesh": f"builtin:{rng.choice(VEHICLES)}", "texture_size": SIZE}
    ground = {"color": [float(rng.uniform(0.2, 0.8))] * 3}
    altitude = rng.uniform(-8, 0) if rng.random() < 0.2 else rng.uniform(3, 80)
    fog = Fog(
        visibility=float(np.exp(rng.uniform(np.log(30), np.log(60_000)))),
        height=float(rng.uniform(3, 100)),
        albedo=float(rng.uniform(0.9, 1.0)),
    )
    weather = Weather(
        float(altitude),
        float(rng.uniform(0, 360)),
        float(rng.uniform(2, 8)),
        fog=fog if rng.random() < 0.4 else None,
    )
    azimuth, elevation, distance = rng.uniform([0, 3, 5], [360, 35, 15])
    view = _view(float(azimuth), float(elevation), float(distance))
    blocks = rng.choice([1, 8])
    paint = rng.uniform(0.02, 0.9, (3, blocks, blocks)) ** rng.uniform(0.5, 2.5)
    albedo = torch.from_numpy(paint).float().repeat_interleave(SIZE // blocks, 1)
    albedo = albedo.repeat_interleave(SIZE // blocks, 2).contiguous()
    if rng.random() < 0.25:
        vehicle["glass_transmission"] = float(rng.uniform(0.2, 0.9))
    scene = Scene.model_validate({"vehicle": vehicle, "ground": ground})
    case = Case(scene, albedo, view, weather)
    if effect is not None and effect in SHOWING:
        case = SHOWING[effect](case, rng, (folder or Path()) / f"sky_{seed}.hdr")
    return case


def _view(azimuth: float, elevation: float, distance: float) -> View:
    """The vehicle from there, equally large from everywhere."""
    fov = float(np.degrees(2 * np.arctan(3 / distance)))
    return orbit_view(azimuth, elevation, distance, fov=fov, width=SIZE, height=SIZE)


def _wet(case: Case, rng: np.random.Generator, _sky: Path) -> Case:
    ground = case.scene.ground.model_copy(update={"wetness": float(rng.uniform(0.05, 1))})
    return replace(case, scene=case.scene.model_copy(update={"ground": ground}))


def _in_a_world(case: Case, rng: np.random.Generator, _sky: Path) -> Case:
    name, seed = str(rng.choice(list(BUILTIN_WORLDS))), int(rng.integers(100))
    place = int(rng.integers(len(build_world(name, seed).places)))
    section = WorldSection(file=f"builtin:{name}", seed=seed, place=place)
    azimuth, elevation, distance = rng.uniform([0, 5, 5], [360, 25, FARTHEST])
    scene = case.scene.model_copy(update={"world": section})
    return replace(case, scene=scene, view=_view(float(azimuth), float(elevation), float(distance)))


def _at_night(case: Case, rng: np.random.Generator, sky: Path) -> Case:
    weather = replace(case.weather, sun_altitude=float(rng.uniform(-18, -1)))
    return replace(_in_a_world(case, rng, sky), weather=weather)


def _under_lamps(case: Case, rng: np.random.Generator, sky: Path) -> Case:
    """A measured sky of even light and a few lamps."""
    directions = sky_directions(MAP_ROWS, 2 * MAP_ROWS)
    radiance = np.full((MAP_ROWS, 2 * MAP_ROWS, 3), 0.2)
    for _ in range(rng.integers(2, 8)):
        azimuth, altitude = np.radians(rng.uniform([0, 10], [360, 80]))
        toward = [np.cos(altitude) * np.cos(azimuth), np.cos(altitude) * np.sin(azimuth)]
        lamp = directions @ [*toward, np.sin(altitude)] > np.cos(np.radians(LAMP_RADIUS))
        radiance[lamp] = np.exp(rng.uniform(np.log(10), np.log(1000)))
    cv2.imwrite(str(sky), np.float32(radiance))
    section = SkySection(map=str(sky.absolute()))
    scene = case.scene.model_copy(update={"sky": section})
    return replace(case, scene=scene, weather=replace(scene.weather(), fog=case.weather.fog))


SHOWING: dict[str, Callable[[Case, np.random.Generator, Path], Case]] = {
    "wetness": _wet,
    "surroundings": _in_a_world,
    "lamps": _at_night,
    "sky": _under_lamps,
}
"""Effects that plain cases do not show → what puts them in."""
