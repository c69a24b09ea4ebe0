"""All that lights a path beside the geometry."""

from __future__ import annotations

from dataclasses import dataclass

from cnca.mi_bridge.envmap import DirectionTable, PhotographedGround
from cnca.mi_bridge.fog_layer import FogLayer, SunShare
from cnca.mi_bridge.lamps import Lamps
from cnca.mi_bridge.panes import pane_transmittance
from cnca.mi_bridge.probe import Probe
from cnca.mi_bridge.sky import Sky
from cnca.mi_bridge.variant import mi


@dataclass
class Surroundings:
    """Everything but geometry and materials."""

    sky: Sky
    fog: FogLayer | None
    panes: bool = False
    """Whether some of the geometry is thin glass, or has holes, that paths and sunlight pass."""
    probe: Probe | None = None
    """The world's light, where its geometry is not traced."""
    photo: PhotographedGround | None = None
    """Ground that shows what the sky's map has below the horizon."""
    lamps: Lamps | None = None
    """The world's lamps, while they are on."""
    brightest: float | None = None
    """Most that a surface seen by another reflects of the sun's irradiance, per steradian.

    Without it one path in thousands meets the sun that lacquer or windows throw on a matt surface,
    and leaves a white speck; white paper reflects 1/π.
    """

    @property
    def table(self) -> DirectionTable | None:
        """Where surfaces draw directions of the sky from; what stands before it must be traced."""
        return self.sky.table if self.probe is None else None

    def radiance(self, d: mi.Vector3f, active: mi.Bool) -> mi.Color3f:
        """What arrives from direction ``d`` along a ray that meets no geometry."""
        return (self.probe or self.sky).radiance(d, active)

    def sun_in_fog(self, scene: mi.Scene) -> SunShare | None:
        """What of the direct sun gets into the fog of a world; None where nothing shades it."""
        if self.fog is None or not self.fog.shaded or not self.sky.has_sun:
            return None
        if self.probe is not None:
            return self.probe.sun_share
        towards = mi.Vector3f(self.sky.sun_direction)
        return lambda p, active: pane_transmittance(scene, mi.Ray3f(p, towards), active)
