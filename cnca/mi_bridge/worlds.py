"""A renderer's worlds: one of them traced at a time, and what is kept of all that were."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from cnca.core.errors import SceneError
from cnca.effects.caustics import BOUNDS
from cnca.effects.world import GEOMETRY
from cnca.mi_bridge.atmosphere import DARKEST, Atmosphere
from cnca.mi_bridge.fog_layer import FogLayer
from cnca.mi_bridge.geometry import Geometry
from cnca.mi_bridge.lamps import Lamps
from cnca.mi_bridge.light import Light, lambertian_white
from cnca.mi_bridge.measure_fog import measure_fog
from cnca.mi_bridge.measure_lamps import KeptLamps, measure_lamps
from cnca.mi_bridge.measure_probe import METER, PANORAMA, Resolution, measure
from cnca.mi_bridge.near_ground import near_ground
from cnca.mi_bridge.probe import Kept, Probe
from cnca.mi_bridge.surroundings import Surroundings
from cnca.mi_bridge.variant import mi
from cnca.scene.cameras import Spot, View
from cnca.world.model import World

VEHICLE_HALF = 2.0
"""Metres around the vehicle's middle over which the sun's share is averaged."""


class Worlds:
    """Worlds around one vehicle; the traced one holds the code of its many materials.

    So it is released before pictures that do without it are rendered.
    """

    def __init__(self, make: Callable[[Spot], World], alone: Geometry) -> None:
        """
        Args:
            make: the world, moved around the vehicle, that a spot names.
            alone: the vehicle on bare ground.
        """
        self._make, self._alone = make, alone
        self._traced: tuple[Spot, Geometry, Geometry] | None = None
        self._lit = False  # whether its lamps are on
        self._near: dict[Spot, Geometry] = {}
        self._ground: dict[Spot, list[mi.Mesh]] = {}
        self._lamplit: dict[tuple[Spot, Atmosphere], tuple[Geometry, Lamps | None]] = {}
        self._kept_lamps: dict[tuple[Spot, Atmosphere], KeptLamps | None] = {}
        self._fogs: dict[tuple[Spot, Atmosphere], FogLayer] = {}
        self._probes: dict[tuple[Spot, Atmosphere], Probe] = {}
        self._whites: dict[tuple[Spot, Atmosphere], float] = {}

    def light(
        self, spot: Spot, atmosphere: Atmosphere, rung: str
    ) -> tuple[Geometry, Surroundings, float]:
        """What paths walk through on a rung of the effect "surroundings", and white card there."""
        white, around = self.white(spot, atmosphere), self._around(spot, atmosphere)
        if rung == GEOMETRY:
            traced = self.traced(spot, lit=atmosphere.lamps)
            lamps = self._lamps(traced, atmosphere)
            return traced, replace(around, panes=traced.has_panes, lamps=lamps), white
        if rung == "backdrop":
            self.let_go()
            return self._alone, around, white
        near, lamps = self.near(spot), None
        if atmosphere.lamps:
            near, lamps = self._near_lamps(spot, atmosphere)
        probe = self.probe(spot, atmosphere)
        self.let_go()
        return near, replace(around, probe=probe, lamps=lamps), white

    def traced(self, spot: Spot, *, lit: bool | None = None) -> Geometry:
        """The vehicle in the world, all of whose geometry is there; None: whether lit or not."""
        return self._both(spot, lit=lit)[0]

    def near(self, spot: Spot) -> Geometry:
        """The vehicle on the ground near it, the rest of the world left to its probe."""
        if spot not in self._near:
            ground = near_ground(self._both(spot)[1])
            self._ground[spot] = [] if ground is None else [ground]
            self._near[spot] = self._alone.among(self._ground[spot])
        return self._near[spot]

    def _near_lamps(self, spot: Spot, atmosphere: Atmosphere) -> tuple[Geometry, Lamps | None]:
        """The near ground among those lamps that light it, and what the world leaves of them."""
        key = spot, atmosphere
        if key not in self._lamplit:
            near, kept = self.near(spot), self.lamps(spot, atmosphere)
            lamps = None
            if kept is not None and kept.needed.any():
                emitters = self._both(spot, lit=True)[1].lamps
                chosen = [e for e, needed in zip(emitters, kept.needed, strict=True) if needed]
                shapes = [e.get_shape() for e in chosen if e.get_shape() is not None]
                near = self._alone.among([*self._ground[spot], *shapes], lamps=chosen)
                shares = kept.shares[kept.needed]
                lamps = Lamps(near.scene, chosen, 1 / atmosphere.unit, shares)
            self._lamplit[key] = near, lamps
        return self._lamplit[key]

    def lamps(self, spot: Spot, atmosphere: Atmosphere) -> KeptLamps | None:
        """A world's lamps as the vehicle sees them; None where there are none, or all are off."""
        key = spot, atmosphere
        if key not in self._kept_lamps:
            kept = None
            if atmosphere.lamps:
                bare = self._both(spot, lit=True)[1]
                lamps = self._lamps(bare, atmosphere)
                box = self._alone.vehicle_bounds
                kept = None if lamps is None else measure_lamps(bare, lamps, box)
            self._kept_lamps[key] = kept
        return self._kept_lamps[key]

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
        radiance = kept.radiance.astype(np.float64)
        lamps = self.lamps(spot, atmosphere)
        if lamps is not None:
            radiance += lamps.as_sky(*radiance.shape[:2])
        light = Light(direction, share * atmosphere.sun, radiance)
        return light, self.white(spot, atmosphere)

    def white(self, spot: Spot, atmosphere: Atmosphere) -> float:
        """Radiance shown as 1, metered between the light at the vehicle and that of the open.

        In the shade of houses a photographer opens the lens, but not so far that the sunlit side
        of the street is lost: the geometric mean of both lights, or lamps' where they are brighter.
        """
        key = spot, atmosphere
        if key not in self._whites:
            kept = self._measure(spot, atmosphere, METER)
            share = float(kept.sun_shares[..., 0].mean())
            direction = np.array(atmosphere.surroundings.sky.light.sun_direction)
            here = lambertian_white(kept.radiance, share * atmosphere.sun, direction)
            lamps = self.lamps(spot, atmosphere)
            here += 0.0 if lamps is None else lamps.white()
            between = float(np.sqrt(here * atmosphere.white))
            white = max(here, between, DARKEST * atmosphere.white)
            self._whites[key] = atmosphere.exposed_white(white)
        return self._whites[key]

    def let_go(self) -> None:
        """Forget the traced world."""
        self._traced = None

    def _both(self, spot: Spot, *, lit: bool | None = None) -> tuple[Geometry, Geometry]:
        """The vehicle in the world, and the world without it; None: whether lit or not."""
        if self._traced is None or self._traced[0] != spot or lit not in (None, self._lit):
            self._traced = None  # before the next, or kernels would hold the code of both
            self._lit = bool(lit)
            self._traced = (spot, *self._alone.within(self._make(spot), lit=self._lit))
        return self._traced[1:]

    def _lamps(self, geometry: Geometry, atmosphere: Atmosphere) -> Lamps | None:
        """Those of a world that is traced, where they are on."""
        if not (atmosphere.lamps and geometry.lamps):
            return None
        return Lamps(geometry.scene, geometry.lamps, 1 / atmosphere.unit)

    def _around(self, spot: Spot, atmosphere: Atmosphere) -> Surroundings:
        """Sky and fog, with the light that the fog has in the world."""
        around, key = atmosphere.surroundings, (spot, atmosphere)
        if around.fog is None or around.fog.field.airlight is not None:
            return around
        if key not in self._fogs:
            bare = self._both(spot, lit=atmosphere.lamps)[1]
            bounded = replace(around, brightest=BOUNDS["regularised"])
            self._fogs[key] = around.fog.among(measure_fog(bare, bounded, around.fog))
        return replace(around, fog=self._fogs[key])

    def _measure(self, spot: Spot, atmosphere: Atmosphere, resolution: Resolution) -> Kept:
        bare = self._both(spot, lit=atmosphere.lamps)[1]
        bound, lamps = BOUNDS["regularised"], self._lamps(bare, atmosphere)
        around = self._around(spot, atmosphere)
        around = replace(around, panes=bare.has_panes, brightest=bound, lamps=lamps)
        return measure(bare, around, self._alone.vehicle_bounds, resolution)


def one_spot(views: Sequence[View]) -> Spot:
    """Where the vehicle stands in all of the views; raises SceneError where they differ."""
    spots = {view.spot for view in views}
    if len(spots) != 1:
        raise SceneError(f"views rendered together need one place in the world, got {len(spots)}")
    return spots.pop()
