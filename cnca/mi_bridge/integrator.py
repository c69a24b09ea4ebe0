"""A path tracer for one sun, a sky and a fog layer whose light is known beforehand.

The base colour of painted surfaces is the only differentiable quantity; geometry, light and fog
carry no derivatives.  So radiative backpropagation (Nimier-David et al. 2020) need not walk a path
again, as path replay does (Vicini, Speierer & Jakob 2021): the kernel keeps eleven numbers of each
reflection, which say how the path's light depends on the texel there once its end is known.  Memory
outside the kernel does not grow with the path's length.

Two rays leave each surface: one to the sun, whose direction is certain, and one sampled from the
BSDF, which finds the sky, the fog's light and other surfaces.  No emitter is sampled at random.
Thin panes of glass are passed on the way, in both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cnca.mi_bridge.envmap import (
    DirectionTable,
    EnvironmentMap,
    PhotographedGround,
    importance_table,
)
from cnca.mi_bridge.fog import FogField
from cnca.mi_bridge.forward import ForwardShare
from cnca.mi_bridge.latlong import direction_uv, wrap_columns
from cnca.mi_bridge.light import SUN_HALF_ANGLE, Light
from cnca.mi_bridge.panes import MOST_PANES, pane_transmittance
from cnca.mi_bridge.probe import Probe
from cnca.mi_bridge.variant import dr, mi
from cnca.scene.weather import Fog


def _opaque_vector(values: np.ndarray) -> mi.Vector3f:
    """A vector that kernels read from memory, so that another value needs no other kernel."""
    vector = mi.Vector3f(*values.tolist())
    dr.make_opaque(vector)
    return vector


def _opaque_float(value: float) -> mi.Float:
    return dr.opaque(mi.Float, value)


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
        self.sun_direction = _opaque_vector(light.sun_direction)
        self.sun_irradiance = _opaque_vector(light.sun_irradiance)
        self.has_sun = bool(light.sun_irradiance.max() > 0)
        self._columns = light.sky.shape[1]
        self._ground = _opaque_vector(light.sky[-1, 0])
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


class FogLayer:
    """Closed-form transmittance through the layer, and the light that it adds to a ray."""

    def __init__(
        self, fog: Fog, field: FogField, sky: Sky, forward: ForwardShare | None = None
    ) -> None:
        """Without ``forward`` the fog in front of the vehicle scatters as over bare ground.

        A field of one airlight is not looked up.
        """
        self.sigma_t = _opaque_float(fog.extinction)
        self.height = _opaque_float(fog.height)
        self.albedo = _opaque_float(fog.albedo)
        self.asymmetry = _opaque_float(fog.asymmetry)
        self.stretch = _opaque_float(field.stretch)
        self.tanh_stretch = _opaque_float(np.tanh(field.stretch))
        self.sky = sky
        # Below the horizon the sun's slant path is endless and its light zero: keep 1/μ finite.
        self.inv_mu_sun = dr.rcp(dr.maximum(sky.sun_direction.z, 1e-4))
        dr.make_opaque(self.inv_mu_sun)
        self.forward = forward
        self.covers = forward is not None and fog.height > forward.top
        self._airlight = None if field.airlight is None else _opaque_vector(field.airlight)
        if self._airlight is not None:
            return
        self._levels, _, self._columns, _ = field.source.shape
        table = field.source
        if forward is not None:
            table = np.concatenate([field.source, field.radiance], axis=-1)
        self._table = mi.Texture3f(wrap_columns(table), wrap_mode=dr.WrapMode.Clamp)

    def sun_transmittance(self, z: mi.Float) -> mi.Float:
        """Share of the sun's light that reaches height ``z``; no lanes divide by zero."""
        above = dr.clip(self.height - z, 0, self.height)
        return dr.exp(-self.sigma_t * above * self.inv_mu_sun)

    def sky_transmittance(self, z: mi.Float, d: mi.Vector3f) -> mi.Float:
        """Share of the sky's light from above along ``d`` that reaches height ``z``."""
        above = dr.clip(self.height - z, 0, self.height)
        return dr.exp(-self.sigma_t * above / dr.maximum(d.z, 1e-4))

    def segment(
        self, ray: mi.Ray3f, si: mi.SurfaceInteraction3f, sample: mi.Float, active: mi.Bool
    ) -> tuple[mi.Float, mi.Color3f]:
        """Transmittance of a ray up to ``si`` (may be infinitely far) and its in-scattered light.

        The light is ∫ σ_t T(s) J(s) ds, estimated at one distance drawn in proportion to
        σ_t exp(−σ_t s).  On rays that end on the vehicle T and J are those of
        :mod:`cnca.mi_bridge.forward`.
        """
        start, end = self._interval(ray, si.t)
        length = dr.select(end > start, end - start, 0)  # ∞ − ∞ for rays that never enter
        opacity = 1 - dr.exp(-self.sigma_t * length)
        # Invert the cumulative share of opacity; log1p stays exact for thin fog.
        s = dr.minimum(-dr.log(1 - sample * opacity) / self.sigma_t, length)
        z = dr.clip(ray.o.z + (start + s) * ray.d.z, 0, self.height)
        lit = active & (opacity > 0)
        J, bare = self._source_function(z, ray.d, lit)
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

    def _interval(self, ray: mi.Ray3f, distance: mi.Float) -> tuple[mi.Float, mi.Float]:
        """Where the ray is below the layer's top, as a range of distances."""
        # On the top itself only a ray that goes down is inside.
        inside = (ray.o.z < self.height) | ((ray.o.z == self.height) & (ray.d.z < 0))
        crossing = (self.height - ray.o.z) / dr.select(ray.d.z == 0, 1, ray.d.z)
        crosses = (ray.d.z != 0) & (crossing > 0)
        start = dr.select(inside, 0, dr.select(crosses, crossing, distance))
        end = dr.select(inside & crosses, dr.minimum(crossing, distance), distance)
        return dr.minimum(start, distance), end

    def _source_function(
        self, z: mi.Float, d: mi.Vector3f, active: mi.Bool
    ) -> tuple[mi.Color3f, mi.Color3f]:
        """J and I at height ``z`` seen along ``d`` (I is 0 where no forward share asks for it)."""
        if self._airlight is not None:
            return mi.Color3f(self._airlight), mi.Color3f(0)
        uv = direction_uv(d, self._columns)
        # The inverse of fog.level_heights.
        t = dr.atanh((2 * z / self.height - 1) * self.tanh_stretch) / self.stretch
        level = (1 + t) / 2
        w = (level * (self._levels - 1) + 0.5) / self._levels
        values = self._table.eval(mi.Point3f(uv.x, uv.y, w), active)
        g, to_sun = self.asymmetry, self.sky.sun_direction
        # 1 + g² − 2g cos without the difference of nearly equal numbers where the lobe is narrow.
        apart = dr.squared_norm(d - dr.sign(g) * to_sun)
        spread = dr.square(1 - dr.abs(g)) + dr.abs(g) * apart
        phase = (1 - g * g) * dr.inv_four_pi / (spread * dr.sqrt(spread))
        sun = self.albedo * phase * self.sun_transmittance(z)
        J = mi.Color3f(*values[:3]) + sun * mi.Color3f(self.sky.sun_irradiance)
        return J, mi.Color3f(*values[3:]) if len(values) > 3 else mi.Color3f(0)


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
    brightest: float | None = None
    """Most that a surface seen by another reflects of the sun's irradiance, per steradian.

    Without it sun that lacquer or windows throw on a matt surface is met by one path in thousands,
    a white speck; white paper reflects 1/π.
    """

    @property
    def table(self) -> DirectionTable | None:
        """From which surfaces draw directions of the sky; what stands before it must be traced."""
        return self.sky.table if self.probe is None else None

    def radiance(self, d: mi.Vector3f, active: mi.Bool) -> mi.Color3f:
        """What arrives from direction ``d`` along a ray that meets no geometry."""
        return (self.probe or self.sky).radiance(d, active)


SHARP = 3.0
"""Density (1/sr) of a direction from which on a lobe counts as a mirror, in which glints are seen
rather than gathered; that of matt surfaces is at most 1/π."""
SLOPES = dr.ADFlag.Default | dr.ADFlag.AllowNoGrad
"""Without a sun none of its light depends on the texture."""


@dataclass
class Reflection:
    """What a path leaves behind at a surface, for the gradient of its light in the albedo there.

    A colour of light depends on the same colour of the albedo alone, and no density on any.
    """

    uv: mi.Point2f
    gathered: mi.Color3f
    """The path's light up to here, with what the surface reflects of the sun."""
    sun_slope: mi.Color3f
    """Derivative of what the surface reflects of the sun, and of the sky where it is sampled."""
    onward_slope: mi.Color3f
    """Derivative of the reflection's weight, over that weight."""

    def slope(self, L: mi.Color3f) -> mi.Color3f:
        """Derivative of the whole path's light ``L``."""
        return self.sun_slope + (L - self.gathered) * self.onward_slope


def _keep(
    here: Reflection, reflections: list[Reflection], depth: mi.UInt32, active: mi.Bool
) -> list[Reflection]:
    """All reflections, the present one put in its place: Dr.Jit 1.5 errs in a ``dr.Local``."""
    places = enumerate(reflections)
    return [dr.select(active & (depth == place), here, kept) for place, kept in places]


@dr.syntax
def trace(  # noqa: C901  (one kernel, as prb.py has it)
    scene: mi.Scene,
    surroundings: Surroundings,
    sampler: mi.Sampler,
    ray: mi.Ray3f,
    first_reflection: list[mi.Float],
    bounces: int,
    differentiable: bool = False,
    lanes: mi.Bool | None = None,
    reflected: bool = False,
) -> tuple[mi.Color3f, list[Reflection]]:
    """Follow one path per ray and return its radiance (linear RGB) and its reflections.

    Args:
        first_reflection: three random numbers per ray that choose its first reflection.
        bounces: surface reflections of a path, ≥ 1; 1 is sun and sky alone.
        differentiable: whether to keep the reflections; the texture has 1 as its derivative then.
        lanes: paths to follow, the others stay dark; by default all.
        reflected: whether the rays come from a surface, not from a camera.
    """
    sky, fog, probe = surroundings.sky, surroundings.fog, surroundings.probe
    photo, table = surroundings.photo, surroundings.table
    context = mi.BSDFContext()
    catching = photo is not None and fog is None
    longest = bounces + 1 + (MOST_PANES if surroundings.panes else 0)

    ray = mi.Ray3f(dr.detach(ray))  # current segment
    depth = mi.UInt32(0)  # reflections so far
    panes = mi.UInt32(0)  # panes passed so far
    L = mi.Color3f(0)  # gathered
    β = mi.Color3f(1)  # throughput
    caught = mi.Bool(False)  # whether the last surface was a photograph
    pdf = mi.Float(0)  # of the direction, if the last surface sampled the sky, too; else 0
    spread = mi.Bool(reflected)  # whether a surface before sent the path on in a wide lobe
    reflections = [dr.zeros(Reflection) for _ in range(bounces if differentiable else 0)]
    active = mi.Bool(True) if lanes is None else mi.Bool(lanes)  # lanes that still walk

    while dr.hint(active, max_iterations=longest, label="path"):
        si = scene.ray_intersect(ray, ray_flags=mi.RayFlags.All, coherent=depth == 0, active=active)
        hit = active & si.is_valid()
        escapes = active & ~si.is_valid()
        towards = ray.d  # where the sky is looked up
        if dr.hint(photo is not None, mode="scalar"):
            looks = depth == 0
            escapes |= active & looks & photo.ends(si)  # type: ignore[union-attr]
            hit &= ~escapes
            towards = dr.select(looks, photo.towards(ray), ray.d)  # type: ignore[union-attr]

        # ---------------- light of the segment: fog and sky ----------------
        Le = mi.Color3f(0)
        if dr.hint(fog is not None, mode="scalar"):
            T, airlight = fog.segment(ray, si, sampler.next_1d(active), active)  # type: ignore[union-attr]
            if dr.hint(probe is not None, mode="scalar"):  # which has the fog in it
                T, airlight = dr.select(escapes, 1, T), dr.select(escapes, 0, airlight)
            Le += β * airlight
            β *= T
        if dr.hint(catching or table is not None, mode="scalar"):
            L_sky = surroundings.radiance(towards, escapes)
            if dr.hint(table is not None, mode="scalar"):
                density = table.density(ray.d, escapes)  # type: ignore[union-attr]
                L_sky *= dr.select((pdf > 0) & ~caught, pdf / (pdf + density), 1)
            if dr.hint(catching, mode="scalar"):
                L_sky = dr.select(caught, photo.evened_sky(ray.d, pdf), L_sky)  # type: ignore[union-attr]
            Le += dr.select(escapes, β * L_sky, 0)
        else:
            Le += dr.select(escapes, β * surroundings.radiance(towards, escapes), 0)

        # ---------------- light of the sun at the surface ----------------
        active_next = hit & (depth < bounces)
        bsdf = si.bsdf(ray)
        if dr.hint(photo is not None, mode="scalar"):
            on_photo = active_next & photo.shows(si)  # type: ignore[union-attr]
            f_photo = photo.reflected(si.p, on_photo)  # type: ignore[union-attr]
        Lr = mi.Color3f(0)
        if dr.hint(sky.has_sun, mode="scalar"):
            to_sun = sky.to_sun(sampler, active_next)
            shadow_ray = si.spawn_ray(to_sun)
            E_sun = mi.Color3f(sky.sun_irradiance)
            if dr.hint(surroundings.panes, mode="scalar"):
                E_sun *= pane_transmittance(scene, shadow_ray, active_next)
                sunlit = active_next & (dr.max(E_sun) > 0)
            else:
                sunlit = active_next & ~scene.ray_test(shadow_ray, active=active_next)
            if dr.hint(fog is not None, mode="scalar"):
                E_sun *= fog.sun_transmittance(si.p.z)  # type: ignore[union-attr]
            if dr.hint(probe is not None, mode="scalar"):
                E_sun *= probe.sun_share(si.p, sunlit)  # type: ignore[union-attr]
            if dr.hint(photo is not None, mode="scalar"):
                Le += dr.select(on_photo & sunlit, β * f_photo * E_sun * to_sun.z, 0)
                sunlit &= ~on_photo
            with dr.resume_grad(when=differentiable):
                f_sun = bsdf.eval(context, si, si.to_local(to_sun), sunlit)
                if dr.hint(surroundings.brightest is not None, mode="scalar"):
                    limited = dr.minimum(f_sun, surroundings.brightest)
                    f_sun = dr.select(spread, limited, f_sun)
                Lr = dr.select(sunlit, β * f_sun * E_sun, 0)

        # ---------------- light of the sky at the surface, where it is sampled ----------------
        if dr.hint(table is not None, mode="scalar"):
            skylit = mi.Bool(active_next)
            if dr.hint(catching, mode="scalar"):
                skylit &= ~on_photo
            to_sky, density = table.sample(sampler.next_2d(skylit), skylit)  # type: ignore[union-attr]
            sky_ray = si.spawn_ray(to_sky)
            E_sky = sky.radiance(to_sky, skylit) / density
            if dr.hint(surroundings.panes, mode="scalar"):
                E_sky *= pane_transmittance(scene, sky_ray, skylit)
                skylit &= dr.max(E_sky) > 0
            else:
                skylit &= ~scene.ray_test(sky_ray, active=skylit)
            if dr.hint(fog is not None, mode="scalar"):
                E_sky *= fog.sky_transmittance(si.p.z, to_sky)  # type: ignore[union-attr]
            wo_sky = si.to_local(to_sky)
            E_sky *= density / (density + dr.detach(bsdf.pdf(context, si, wo_sky, skylit)))
            with dr.resume_grad(when=differentiable):
                f_sky = bsdf.eval(context, si, wo_sky, skylit)
                if dr.hint(photo is not None, mode="scalar"):
                    f_sky = dr.select(on_photo, f_photo * wo_sky.z, f_sky)
                Lr += dr.select(skylit, β * f_sky * E_sky, 0)

        L += Le + dr.detach(Lr)

        # ---------------- next segment ----------------
        lobe, across = sampler.next_1d(active_next), sampler.next_2d(active_next)
        first = depth + panes == 0
        lobe = dr.select(first, first_reflection[0], lobe)
        across = dr.select(first, mi.Point2f(*first_reflection[1:]), across)
        with dr.resume_grad(when=differentiable):
            bs, weight = bsdf.sample(context, si, lobe, across, active_next)
            if dr.hint(differentiable, mode="scalar"):
                sun_slope, slope = dr.forward_to(Lr, weight, flags=SLOPES)
                bs, weight = dr.detach(bs), dr.detach(weight)
                onward_slope = dr.select(weight > 0, slope / weight, 0)
                here = Reflection(si.uv, L, sun_slope, onward_slope)
                reflections = _keep(here, reflections, depth, active_next)
        wo = si.to_world(bs.wo)
        if dr.hint(catching, mode="scalar"):
            wo_photo, density = photo.table.sample(across, on_photo)  # type: ignore[union-attr]
            weight = dr.select(on_photo, f_photo * wo_photo.z / density, weight)
            wo = dr.select(on_photo, wo_photo, wo)
        elif dr.hint(photo is not None, mode="scalar"):
            weight = dr.select(on_photo, dr.pi * f_photo, weight)
        active_next &= dr.max(weight) > 0
        ray_next = si.spawn_ray(wo)
        pdf_next, caught_next = mi.Float(0), mi.Bool(False)
        if dr.hint(table is not None, mode="scalar"):
            smooth = ~mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta)
            pdf_next = dr.select(smooth, bs.pdf, 0)
        if dr.hint(catching, mode="scalar"):
            pdf_next, caught_next = dr.select(on_photo, density, pdf_next), on_photo

        β *= weight
        ray = ray_next
        if dr.hint(surroundings.brightest is not None, mode="scalar"):
            mirrored = mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta) | (bs.pdf >= SHARP)
            spread |= active_next & ~mirrored
        if dr.hint(surroundings.panes, mode="scalar"):
            passed = active_next & mi.has_flag(bs.sampled_type, mi.BSDFFlags.Null)
            active_next &= ~passed | (panes < MOST_PANES)
            panes += dr.select(passed, 1, 0)
            depth += dr.select(passed, 0, 1)
            # Thin glass bends no ray.
            pdf_next = dr.select(passed, pdf, pdf_next)
            caught_next = dr.select(passed, caught, caught_next)
        else:
            depth += 1
        pdf, caught = pdf_next, caught_next
        active = active_next

    return L, reflections
