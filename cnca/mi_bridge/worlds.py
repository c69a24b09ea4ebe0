"""A renderer's worlds: one of them traced at a time, and what is kept of all that were."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from cnca.core.errors import SceneError
from cnca.effects.caustics import BOUNDS
from cnca.effects.world import GEOMETRY
from cnca.mi_bridge.atmosphere import DARKEST, Atmosphere
from cnca.mi_bridge.geometry import Geometry
from cnca.mi_bridge.light import Light, lambertian_white
from cnca.mi_bridge.measure_probe import METER, PANORAMA, Resolution, measure
from cnca.mi_bridge.near_ground import near_ground
from cnca.mi_bridge.probe import Kept, Probe
from cnca.mi_bridge.surroundings import Surroundings
from cnca.scene.cameras import Spot, View
from cnca.world.model import World

VEHICLE_HALF = 2.0
"""Metres around the vehicle's middle over which the sun's share is averaged."""


class Worlds:
    """Worlds around one vehicle; the traced one holds the code of its many materials.

    So it is let go before pictures are rendered that do without it.
    """

    def __init__(self, make: Callable[[Spot], World], alone: Geometry) -> None:
        """
        Args:
            make: the world, moved around the vehicle, that a spot names.
            alone: the vehicle on bare ground.
        """
        self._make, self._alone = make, alone
        self._traced: tuple[Spot, Geometry, Geometry] | None = None
        self._near: dict[Spot, Geometry] = {}
        self._probes: dict[tuple[Spot, Atmosphere], Probe] = {}
        self._whites: dict[tuple[Spot, Atmosphere], float] = {}

    def light(
        self, spot: Spot, atmosphere: Atmosphere, rung: str
    ) -> tuple[Geometry, Surroundings, float]:
        """What paths walk through on a rung of the effect "surroundings", and white card there."""
        white, around = self.white(spot, atmosphere), atmosphere.surroundings
        if rung == GEOMETRY:
            traced = self.traced(spot)
            return traced, replace(around, panes=traced.has_panes), white
        if rung == "backdrop":
            self.let_go()
            return self._alone, around, white
        near, probe = self.near(spot), self.probe(spot, atmosphere)
        self.let_go()
        return near, replace(around, probe=probe), white

    def traced(self, spot: Spot) -> Geometry:
        """The vehicle in the world, all of whose geometry is there."""
        return self._both(spot)[0]

    def near(self, spot: Spot) -> Geometry:
        """The vehicle on the ground near it, the rest of the world left to its probe."""
        if spot not in self._near:
            ground = near_ground(self._both(spot)[1])
            self._near[spot] = self._alone.among([] if ground is None else [ground])
        return self._near[spot]

    def probe(self, spot: Spot, atmosphere: Atmosphere) -> Probe:
        """The world's light at the vehicle."""
        key = spot, atmosphere
        if key not in self._probes:
            self._probes[key] = Probe(self._measure(spot, atmosphere, PANORAMA))
        return self._probes[key]

    def kept_light(self, spot: Spot, atmosphere: Atmosphere) -> tuple[Light, float]:
        """The probe's panorama as a sky, and as much of the sun as reaches the vehicle."""
        kept = self.probe(spot, atmosphere).kept
        low, high = (np.array([-1.0, 1.0]) * VEHICLE_HALF / kept.half_width + 1) / 2
        size = len(kept.sun_shares)
        inner = slice(int(low * size), max(int(high * size), int(low * size) + 1))
        share = float(kept.sun_shares[inner, inner, 0].mean())
        direction = np.array(atmosphere.surroundings.sky.light.sun_direction)
        light = Light(direction, share * atmosphere.sun, kept.radiance.astype(np.float64))
        return light, self.white(spot, atmosphere)

    def white(self, spot: Spot, atmosphere: Atmosphere) -> float:
        """Radiance of white card, metered between the light at the vehicle and that of the open.

        In the shade of houses a photographer opens the lens, but not so far that the sunlit side
        of the street is lost: the geometric mean of both lights, or lamps' where they are brighter.
        """
        key = spot, atmosphere
        if key not in self._whites:
            kept = self._measure(spot, atmosphere, METER)
            share = float(kept.sun_shares[..., 0].mean())
            direction = np.array(atmosphere.surroundings.sky.light.sun_direction)
            here = lambertian_white(kept.radiance, share * atmosphere.sun, direction)
            between = float(np.sqrt(here * atmosphere.white))
            self._whites[key] = max(here, between, DARKEST * atmosphere.white)
        return self._whites[key]

    def let_go(self) -> None:
        """Forget the traced world."""
        self._traced = None

    def _both(self, spot: Spot) -> tuple[Geometry, Geometry]:
        """The vehicle in the world, and the world without it."""
        if self._traced is None or self._traced[0] != spot:
            self._traced = None  # before the next, or kernels would hold the code of both
            self._traced = (spot, *self._alone.within(self._make(spot)))
        return self._traced[1:]

    def _measure(self, spot: Spot, atmosphere: Atmosphere, resolution: Resolution) -> Kept:
        bare = self._both(spot)[1]
        bound = BOUNDS["regularised"]
        around = replace(atmosphere.surroundings, panes=bare.has_panes, brightest=bound)
        return measure(bare, around, self._alone.vehicle_bounds, resolution)


def one_spot(views: Sequence[View]) -> Spot:
    """Where the vehicle stands in all of the views; raises SceneError where they differ."""
    spots = {view.spot for view in views}
    if len(spots) != 1:
        raise SceneError(f"views rendered together need one place in the world, got {len(spots)}")
    return spots.pop()
