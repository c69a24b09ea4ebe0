"""What stands and shines in a renderer's pictures, built when it is first asked for, and kept."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
from jaxtyping import Float

from cnca.effects.caustics import BOUNDS
from cnca.effects.plan import EffectPlan
from cnca.mi_bridge.atmosphere import Atmosphere, make_atmosphere
from cnca.mi_bridge.forward import ForwardShare
from cnca.mi_bridge.geometry import Geometry
from cnca.mi_bridge.light import Light
from cnca.mi_bridge.sightings import Sightings
from cnca.mi_bridge.surroundings import Surroundings
from cnca.mi_bridge.wet import wet_albedo
from cnca.mi_bridge.worlds import Worlds, one_spot
from cnca.scene.cameras import Spot, View
from cnca.scene.weather import Weather
from cnca.vehicle.model import Part, Vehicle
from cnca.world.model import World

WEATHERS_KEPT = 64
"""Weathers whose sky and fog stay in memory (about 3 MB each)."""


class BuiltScene:
    """Mitsuba's side of one vehicle, of the worlds around it and of the weathers over them."""

    def __init__(
        self,
        vehicle: Vehicle,
        *,
        ground_albedo: Float[np.ndarray, "3"],
        texture_size: int,
        props: tuple[Part, ...],
        worlds: Callable[[Spot], World] | None,
        worn: tuple[str, str, str],
        wetness: float = 0.0,
    ) -> None:
        """
        Args:
            ground_albedo: linear RGB in [0, 1].
            texture_size: texels per side of the vehicle's texture.
            props: other things that stand around; painted ones wear the vehicle's texture.
            worlds: what stands around the vehicle, which faces +x in its origin, at each spot.
            worn: models of the effects "materials", "glass" and "wetness" to begin with.
            wetness: of the ground, in [0, 1].
        """
        self._ground_albedo, self._has_vehicle = ground_albedo, bool(vehicle.parts)
        self._wetness = wetness
        texels = max(texture_size, 2)  # Mitsuba knows no texture of one texel: it is repeated
        self._make = partial(Geometry, vehicle, ground_albedo, texels, props)
        self._make_world = worlds
        self._forward_share = lru_cache(ForwardShare)
        self.atmosphere = lru_cache(maxsize=WEATHERS_KEPT)(self._make_atmosphere)
        self._sightings = lru_cache(1)(self._find_objects)
        self._worn = worn
        self.geometry = self._build(*worn)
        self.worlds = Worlds(worlds, self.geometry) if worlds else None

    def _build(self, materials: str, glass: str, wetness: str) -> Geometry:
        return self._make(materials, glass, self._wetness if wetness == "film" else 0.0)

    def wear(self, materials: str, glass: str, wetness: str) -> None:
        """Exchange the geometry: kernels hold the code of all materials that exist."""
        if (materials, glass, wetness) != self._worn:
            self.atmosphere.cache_clear()
            self._forward_share.cache_clear()
            self._worn = materials, glass, wetness
            self.geometry = self._build(*self._worn)
            if self._make_world is not None:
                self.worlds = Worlds(self._make_world, self.geometry)

    def lit(
        self, chosen: EffectPlan, views: Sequence[View], rung: str
    ) -> tuple[Geometry, Surroundings, float]:
        """What the paths of these pictures walk through, and the radiance that is shown as 1.

        Args:
            rung: how much of a world takes part.
        """
        self.wear(*(str(chosen[effect]) for effect in ("materials", "glass", "wetness")))
        atmosphere = self.atmosphere(
            chosen.weather,
            str(chosen["sun"]),
            str(chosen["sky"]),
            str(chosen["fog"]),
            str(chosen["lamps"]),
        )
        geometry, around = self.geometry, atmosphere.surroundings
        white = atmosphere.exposed_white(atmosphere.white)
        if self.worlds is not None:
            geometry, around, white = self.worlds.light(one_spot(views), atmosphere, rung)
        return geometry, replace(around, brightest=BOUNDS[str(chosen["caustics"])]), white

    def light_at(self, weather: Weather, spot: Spot) -> tuple[Light, float]:
        """The light of a world without the vehicle, seen from its middle, and white card there."""
        assert self.worlds is not None
        weather = replace(weather, fog=None)  # as plain shading has it
        lamps = "sampled" if weather.lamps_lit else "off"
        atmosphere = self.atmosphere(weather, "direction", "map", "none", lamps)
        return self.worlds.kept_light(spot, atmosphere)

    def traced(self, views: Sequence[View]) -> Geometry:
        """The vehicle with all that stands around it in these views."""
        return self.worlds.traced(one_spot(views)) if self.worlds else self.geometry

    def objects(self, views: Sequence[View]) -> Sightings | None:
        """All else with a label that stands around the vehicle; None without a world."""
        return self._sightings(one_spot(views)) if self.worlds else None

    def _find_objects(self, spot: Spot) -> Sightings:
        assert self._make_world is not None
        return Sightings(self._make_world(spot))

    def _make_atmosphere(
        self, weather: Weather, sun: str, sky: str, fog: str, lamps: str
    ) -> Atmosphere:
        return make_atmosphere(
            weather,
            wet_albedo(self._ground_albedo, self.geometry.wetness),
            sun=sun,
            sky=sky,
            fog=fog,
            panes=self.geometry.has_panes,
            forward=partial(self._forward_share, self.geometry) if self._has_vehicle else None,
            ground=self.geometry.ground if self._make_world is None else None,
            lamps=lamps == "sampled",
        )
