"""The fog's light as kernels read it: a transmittance in closed form and a table."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cnca.mi_bridge.fog import FogField
from cnca.mi_bridge.forward import ForwardShare
from cnca.mi_bridge.latlong import direction_uv, wrap_columns
from cnca.mi_bridge.opaque import opaque_float, opaque_vector
from cnca.mi_bridge.sky import Sky
from cnca.mi_bridge.variant import dr, mi
from cnca.scene.weather import Fog

SunShare = Callable[[mi.Point3f, mi.Bool], mi.Color3f | mi.Float]
"""Point, whether it is asked for → share of the direct sun's light in [0, 1]."""


class FogLayer:
    """Closed-form transmittance through the layer, and the light that it adds to a ray."""

    def __init__(
        self, fog: Fog, field: FogField, sky: Sky, forward: ForwardShare | None = None
    ) -> None:
        """Without ``forward`` the fog in front of the vehicle scatters as over bare ground.

        A field of one airlight is not looked up.
        """
        self.fog, self.field = fog, field
        self.shaded = False  # whether something of a world may stand between it and the sun
        self.sigma_t = opaque_float(fog.extinction)
        self.height = opaque_float(fog.height)
        self.albedo = opaque_float(fog.albedo)
        self.asymmetry = opaque_float(fog.asymmetry)
        self.stretch = opaque_float(field.stretch)
        self.tanh_stretch = opaque_float(np.tanh(field.stretch))
        self.sky = sky
        # Below the horizon the sun's slant path is endless and its light zero: keep 1/μ finite.
        self.inv_mu_sun = dr.rcp(dr.maximum(sky.sun_direction.z, 1e-4))
        dr.make_opaque(self.inv_mu_sun)
        self.forward = forward
        self.covers = forward is not None and fog.height > forward.top
        self._airlight = None if field.airlight is None else opaque_vector(field.airlight)
        if self._airlight is not None:
            return
        self._levels, _, self._columns, _ = field.source.shape
        table = field.source
        if forward is not None:
            table = np.concatenate([field.source, field.radiance], axis=-1)
        self._table = mi.Texture3f(wrap_columns(table), wrap_mode=dr.WrapMode.Clamp)
        self._places = None
        if field.places is not None:
            factors = mi.TensorXf(field.places.factors)
            self._places = mi.Texture3f(factors, wrap_mode=dr.WrapMode.Clamp)
            self._reach = opaque_float(field.places.reach)

    def among(self, field: FogField) -> FogLayer:
        """The same fog in a world, where the light in it is ``field``."""
        other = FogLayer(self.fog, field, self.sky, self.forward)
        other.shaded = True
        return other

    def sun_transmittance(self, z: mi.Float) -> mi.Float:
        """Share of the sun's light that reaches height ``z``; no lane divides by zero."""
        above = dr.clip(self.height - z, 0, self.height)
        return dr.exp(-self.sigma_t * above * self.inv_mu_sun)

    def sky_transmittance(self, z: mi.Float, d: mi.Vector3f) -> mi.Float:
        """Share of the sky's light from above along ``d`` that reaches height ``z``."""
        above = dr.clip(self.height - z, 0, self.height)
        return dr.exp(-self.sigma_t * above / dr.maximum(d.z, 1e-4))

    def transmittance_between(self, p: mi.Point3f, q: mi.Point3f) -> mi.Float:
        """Share of a lamp's light that gets from one point to the other."""
        low, high = dr.minimum(p.z, q.z), dr.maximum(p.z, q.z)
        below = dr.clip(self.height - low, 0, high - low) / dr.maximum(high - low, 1e-4)
        inside = dr.select(high - low > 1e-4, below, dr.select(low < self.height, mi.Float(1), 0))
        return dr.exp(-self.sigma_t * inside * dr.norm(q - p))

    def segment(
        self,
        ray: mi.Ray3f,
        si: mi.SurfaceInteraction3f,
        sample: mi.Float,
        active: mi.Bool,
        sun_share: SunShare | None = None,
    ) -> tuple[mi.Float, mi.Color3f]:
        """Transmittance of a ray up to ``si`` (may be infinitely far) and its in-scattered light.

        ``sun_share`` says what of the direct sun gets to a point through a world; by default all.

        The light is ∫ σ_t T(s) J(s) ds, estimated at one distance drawn in proportion to
        σ_t exp(−σ_t s).  On rays that end on the vehicle T and J are those of
        :mod:`cnca.mi_bridge.forward`.
        """
        start, end = self.interval(ray, si.t)
        length = dr.select(end > start, end - start, 0)  # ∞ − ∞ for rays that never enter
        opacity = 1 - dr.exp(-self.sigma_t * length)
        # Invert the cumulative share of opacity; log1p stays exact for thin fog.
        s = dr.minimum(-dr.log(1 - sample * opacity) / self.sigma_t, length)
        p, lit = ray(start + s), active & (opacity > 0)
        p.z = dr.clip(p.z, 0, self.height)
        share = 1.0 if sun_share is None else sun_share(p, lit)
        J, bare = self._source_function(p, ray.d, lit, share)
        if self.forward is None:
            return 1 - opacity, dr.select(lit, opacity * J, 0)
        ahead = lit & self.forward.geometry.is_surrounded(si)
        u = dr.select(ahead, si.t - start, 0)  # distance from the surface at which fog begins
        f, Φ = self.forward(u - s, ahead)
        Φ_start = self.forward(u, ahead)[1]
        # Fog that covers the vehicle reaches up to its surface, where Φ is 0.
        Φ_end = mi.Float(0) if self.covers else self.forward(u - length, ahead)[1]
        # Optical depths that forward scattering gives back: up to s, and on the whole ray.
        back = self.sigma_t * self.albedo
        regained, regained_all = back * (Φ_start - Φ), back * (Φ_start - Φ_end)
        J = dr.select(ahead, dr.exp(regained) * (J - self.albedo * f * bare), J)
        T = dr.exp(dr.select(ahead, regained_all, 0) - self.sigma_t * length)
        return T, dr.select(lit, opacity * J, 0)

    def interval(self, ray: mi.Ray3f, distance: mi.Float) -> tuple[mi.Float, mi.Float]:
        """Where the ray is below the layer's top, as a range of distances."""
        # On the top itself only a ray that goes down is inside.
        inside = (ray.o.z < self.height) | ((ray.o.z == self.height) & (ray.d.z < 0))
        crossing = (self.height - ray.o.z) / dr.select(ray.d.z == 0, 1, ray.d.z)
        crosses = (ray.d.z != 0) & (crossing > 0)
        start = dr.select(inside, 0, dr.select(crosses, crossing, distance))
        end = dr.select(inside & crosses, dr.minimum(crossing, distance), distance)
        return dr.minimum(start, distance), end

    def _source_function(
        self, p: mi.Point3f, d: mi.Vector3f, active: mi.Bool, sun_share: mi.Color3f | float = 1.0
    ) -> tuple[mi.Color3f, mi.Color3f]:
        """J and I at a point seen along ``d`` (I is 0 where no forward share asks for it)."""
        if self._airlight is not None:
            return mi.Color3f(self._airlight), mi.Color3f(0)
        uv = direction_uv(d, self._columns)
        # The inverse of fog.level_heights.
        t = dr.atanh((2 * p.z / self.height - 1) * self.tanh_stretch) / self.stretch
        level = (1 + t) / 2
        w = (level * (self._levels - 1) + 0.5) / self._levels
        values = self._table.eval(mi.Point3f(uv.x, uv.y, w), active)
        if self._places is not None:
            factor = self._at_place(p, w, d, active)
            values = [value * factor for value in values]
        phase = self.phase(d, self.sky.sun_direction)
        sun = self.albedo * phase * self.sun_transmittance(p.z) * sun_share
        J = mi.Color3f(*values[:3]) + sun * mi.Color3f(self.sky.sun_irradiance)
        return J, mi.Color3f(*values[3:]) if len(values) > 3 else mi.Color3f(0)

    def _at_place(self, p: mi.Point3f, w: mi.Float, d: mi.Vector3f, active: mi.Bool) -> mi.Float:
        """Light at a point relative to that at the origin at the same height."""
        assert self._places is not None
        nodes = self._places.shape[1]
        u, v = (0.5 + (0.5 + 0.5 * x / self._reach) * (nodes - 1) for x in (p.x, p.y))
        a0, *a = self._places.eval(mi.Point3f(u / nodes, v / nodes, w), active)
        return dr.maximum(a0 + dr.dot(mi.Vector3f(*a), d), 0)

    def phase(self, d: mi.Vector3f, to_sun: mi.Vector3f) -> mi.Float:
        """Phase function in 1/sr of the sun's light that an eye looking along ``d`` sees."""
        g = self.asymmetry
        # 1 + g² − 2g cos without the difference of nearly equal numbers where the lobe is narrow.
        apart = dr.squared_norm(d - dr.sign(g) * to_sun)
        spread = dr.square(1 - dr.abs(g)) + dr.abs(g) * apart
        return (1 - g * g) * dr.inv_four_pi / (spread * dr.sqrt(spread))
