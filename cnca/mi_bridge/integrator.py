"""A path tracer for one sun, a sky and a fog layer whose light is known beforehand.

The base color of painted surfaces is the only differentiable quantity; geometry, light and fog
carry no derivatives.  So radiative backpropagation (Nimier-David et al. 2020) need not walk a path
again, as path replay does (Vicini, Speierer & Jakob 2021): the kernel keeps eleven numbers of each
reflection, which say how the path's light depends on the texel there once its end is known.  Memory
outside the kernel does not grow with the path's length.

Two rays leave each surface: one to the sun, whose direction is certain, and one sampled from the
BSDF, which finds the sky, the fog's light and other surfaces.  Only where a measured sky asks for
it does a third one look for its lights.  All of them pass thin panes of glass on the way.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from cnca.mi_bridge.lamps import LampSample
from cnca.mi_bridge.panes import MOST_PANES, pane_transmittance
from cnca.mi_bridge.surroundings import Surroundings
from cnca.mi_bridge.variant import dr, mi

SHARP = 3.0
"""Density (1/sr) of a direction above which a lobe counts as a mirror, in which glints are seen
rather than gathered; that of matt surfaces is at most 1/π."""
SLOPES = dr.ADFlag.Default | dr.ADFlag.AllowNoGrad
"""Without a sun none of its light depends on the texture."""


@dataclass
class Reflection:
    """What a path leaves behind at a surface, for the gradient of its light in the albedo there.

    A color of light depends on the same color of the albedo alone, and no density on any.
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


def lamplight(
    scene: mi.Scene,
    surroundings: Surroundings,
    sampler: mi.Sampler,
    si: mi.SurfaceInteraction3f,
    active: mi.Bool,
) -> LampSample:
    """Light of a lamp drawn for each surface, with all shadows; there are lamps."""
    lamps, fog = surroundings.lamps, surroundings.fog
    assert lamps is not None
    lamp = lamps.sample(si, sampler.next_1d(active), sampler.next_2d(active), active)
    lit = active & (dr.max(lamp.irradiance) > 0)
    ray = si.spawn_ray_to(lamp.p)
    if surroundings.panes:
        lamp.irradiance *= pane_transmittance(scene, ray, lit, lamp.p)
    else:
        lamp.irradiance *= dr.select(scene.ray_test(ray, active=lit), 0, mi.Float(1))
    if fog is not None:
        lamp.irradiance *= fog.transmittance_between(si.p, lamp.p)
    lamp.irradiance = dr.select(lit, lamp.irradiance, 0)
    return lamp


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
    starts: Callable[[mi.SurfaceInteraction3f], mi.Bool] | None = None,
    reflected: bool = False,
) -> tuple[mi.Color3f, list[Reflection]]:
    """Follow one path per ray and return its radiance (linear RGB) and its reflections.

    Args:
        first_reflection: three random numbers per ray that choose its first reflection.
        bounces: surface reflections of a path, ≥ 1; 1 is sun and sky alone.
        differentiable: whether to keep the reflections; the texture has 1 as its derivative then.
        lanes: paths to follow; the others stay dark; by default all.
        starts: whether to follow a path, by what it meets first; likewise.
        reflected: whether the rays come from a surface that has sampled the lamps itself, not from
            a camera.
    """
    sky, fog, probe = surroundings.sky, surroundings.fog, surroundings.probe
    photo, table, lamps = surroundings.photo, surroundings.table, surroundings.lamps
    context = mi.BSDFContext()
    catching = photo is not None and fog is None
    in_fog = surroundings.sun_in_fog(scene)
    longest = bounces + 1 + (MOST_PANES if surroundings.panes else 0)

    ray = mi.Ray3f(dr.detach(ray))  # current segment
    depth = mi.UInt32(0)  # reflections so far
    panes = mi.UInt32(0)  # panes passed so far
    L = mi.Color3f(0)  # gathered
    β = mi.Color3f(1)  # throughput
    caught = mi.Bool(False)  # whether the last surface was a photograph
    pdf = mi.Float(0)  # of the direction, if the last surface sampled the lights, too; else 0
    left = mi.Point3f(ray.o)  # the last surface
    hidden = mi.Bool(reflected)  # whether it left all light of lamps to the ray that it sent to one
    spread = mi.Bool(reflected)  # whether an earlier surface sent the path on in a wide lobe
    reflections = [dr.zeros(Reflection) for _ in range(bounces if differentiable else 0)]
    active = mi.Bool(True) if lanes is None else mi.Bool(lanes)  # lanes that still walk

    while dr.hint(active, max_iterations=longest, label="path"):
        si = scene.ray_intersect(ray, ray_flags=mi.RayFlags.All, coherent=depth == 0, active=active)
        if dr.hint(starts is not None, mode="scalar"):
            active &= (depth + panes > 0) | starts(si)  # type: ignore[misc]
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
            ξ = sampler.next_1d(active)
            T, airlight = fog.segment(ray, si, ξ, active, in_fog)  # type: ignore[union-attr]
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

        # ---------------- lamps and glowing windows that the segment ends on ----------------
        if dr.hint(lamps is not None, mode="scalar"):
            Le += dr.select(hit, β * lamps.seen(si, left, pdf, hidden, hit), 0)  # type: ignore[union-attr]

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

        # ---------------- light of a lamp at the surface ----------------
        if dr.hint(lamps is not None, mode="scalar"):
            lamp = lamplight(scene, surroundings, sampler, si, active_next)
            lamplit = active_next & (dr.max(lamp.irradiance) > 0)
            wo_lamp = si.to_local(lamp.d)
            other = dr.detach(bsdf.pdf(context, si, wo_lamp, lamplit))
            share = dr.select(lamp.density > 0, lamp.density / (lamp.density + other), 1)
            with dr.resume_grad(when=differentiable):
                f_lamp = bsdf.eval(context, si, wo_lamp, lamplit)
                if dr.hint(surroundings.brightest is not None, mode="scalar"):
                    limited = dr.minimum(f_lamp, surroundings.brightest)
                    f_lamp = dr.select(spread, limited, f_lamp * share)
                else:
                    f_lamp *= share
                Lr += dr.select(lamplit, β * f_lamp * lamp.irradiance, 0)

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
        if dr.hint(table is not None or lamps is not None, mode="scalar"):
            smooth = ~mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta)
            pdf_next = dr.select(smooth, bs.pdf, 0)
        if dr.hint(catching, mode="scalar"):
            pdf_next, caught_next = dr.select(on_photo, density, pdf_next), on_photo

        β *= weight
        ray = ray_next
        left_next, hidden_next = mi.Point3f(si.p), mi.Bool(False)
        if dr.hint(lamps is not None and surroundings.brightest is not None, mode="scalar"):
            hidden_next = mi.Bool(spread)
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
            left_next = dr.select(passed, left, left_next)
            hidden_next = dr.select(passed, hidden, hidden_next)
        else:
            depth += 1
        pdf, caught = pdf_next, caught_next
        left, hidden = left_next, hidden_next
        active = active_next

    return L, reflections
