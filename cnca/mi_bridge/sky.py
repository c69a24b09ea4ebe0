"""Sun and sky as kernels read them."""

from __future__ import annotations

import numpy as np

from cnca.mi_bridge.envmap import EnvironmentMap, importance_table
from cnca.mi_bridge.latlong import direction_uv, wrap_columns
from cnca.mi_bridge.light import SUN_HALF_ANGLE, Light
from cnca.mi_bridge.opaque import opaque_vector
from cnca.mi_bridge.variant import dr, mi


class Sky:
    """Sun and sky above the fog."""

    def __init__(
        self,
        light: Light,
        *,
        has_map: bool = True,
        sun_disc: bool = False,
        importance: bool = False,
    ) -> None:
        """Without a map the sky is black; a sun that is a disc casts shadows with soft edges.

        Below the horizon lies lit, endless ground either way, or what a measured map shows there.
        With ``importance`` surfaces sample such a map by its brightness, too.
        """
        self.light, self.has_map, self._sun_disc = light, has_map, sun_disc
        self.sun_direction = opaque_vector(light.sun_direction)
        self.sun_irradiance = opaque_vector(light.sun_irradiance)
        self.has_sun = bool(light.sun_irradiance.max() > 0)
        self._columns = light.sky.shape[1]
        self._ground = opaque_vector(light.sky[-1, 0])
        self.measured = EnvironmentMap(light.map) if has_map and light.map else None
        self.table = importance_table(self.measured) if importance and self.measured else None
        if has_map and not self.measured:
            self._map = mi.Texture2f(wrap_columns(light.sky), wrap_mode=dr.WrapMode.Clamp)

    def radiance(self, d: mi.Vector3f, active: mi.Bool) -> mi.Color3f:
        """Radiance that arrives from direction ``d``, without the sun's disc."""
        if self.measured:
            return self.measured.radiance(d, active)
        if not self.has_map:
            return dr.select(d.z < 0, mi.Color3f(self._ground), 0)
        return mi.Color3f(self._map.eval(direction_uv(d, self._columns), active))

    def to_sun(self, sampler: mi.Sampler, active: mi.Bool) -> mi.Vector3f:
        """Direction to the sun's centre, or to a random point of its disc."""
        if not self._sun_disc:
            return self.sun_direction
        cosine = float(np.cos(SUN_HALF_ANGLE))
        around = mi.warp.square_to_uniform_cone(sampler.next_2d(active), cosine)
        return mi.Frame3f(self.sun_direction).to_world(around)
