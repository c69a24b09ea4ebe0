"""The fog's light in a world: what houses shade and reflect, measured where the vehicle stands.

Over open ground the light in fog depends on height and direction alone and is solved for
(:mod:`cnca.mi_bridge.fog`).  Among houses random walks through fog and world find it.  Neglected:
that it differs from place to place in the street; walks start all around the vehicle.  The sun's
light that is scattered but once is not in it, as in the solution: it is known in closed form but
for shadows, which are traced or the probe's.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cnca.mi_bridge.fog import FogField, level_heights
from cnca.mi_bridge.fog_layer import FogLayer
from cnca.mi_bridge.geometry import Geometry
from cnca.mi_bridge.panes import pane_transmittance
from cnca.mi_bridge.rays import average_samples
from cnca.mi_bridge.surroundings import Surroundings
from cnca.mi_bridge.variant import dr, mi

LEVELS, ROWS, COLUMNS, SAMPLES = 8, 16, 24, 64
"""Of the table, and walks for each of its entries."""
AROUND = 5.0
"""Metres from the vehicle's middle within which walks start."""
LOWEST = 0.05
"""Metres above the ground."""
DEPTH, SURE = 96, 6
"""Most events of a walk, and those before it may end by chance."""
SEED = 0x2C1B3C6D


def measure_fog(bare: Geometry, around: Surroundings, fog: FogLayer) -> FogField:
    """The light in the fog of a world, around its origin.

    Args:
        bare: the world without the vehicle.
        around: its sky.
        fog: the layer as it lies over open ground.
    """
    lanes = LEVELS * ROWS * COLUMNS * SAMPLES
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(dr.opaque(mi.UInt32, SEED), lanes)
    entry = dr.arange(mi.UInt32, lanes) // SAMPLES
    texel = entry % (ROWS * COLUMNS)
    across = sampler.next_2d()
    theta = (mi.Float(texel // COLUMNS) + across.y) * (np.pi / ROWS)
    phi = (mi.Float(texel % COLUMNS) + across.x) * (2 * np.pi / COLUMNS)
    sine, cosine = dr.sincos(theta)
    d = mi.Vector3f(sine * dr.cos(phi), sine * dr.sin(phi), cosine)
    disc = AROUND * mi.warp.square_to_uniform_disk(sampler.next_2d())
    heights = level_heights(fog.fog.height, fog.field.stretch, LEVELS)
    z = dr.gather(mi.Float, mi.Float(np.float32(heights)), entry // (ROWS * COLUMNS))
    p = mi.Point3f(disc.x, disc.y, dr.maximum(z, LOWEST))
    scattered = scattered_direction(d, fog.asymmetry, sampler.next_2d())
    tables = []
    with dr.suspend_grad():
        for direction, weight in ((d, mi.Float(1)), (scattered, fog.albedo)):
            L = _walk(bare.scene, around, fog, sampler, mi.Point3f(p), mi.Vector3f(direction))
            L *= weight
            dr.eval(L, sampler)
            colors = [np.array(average_samples(color, SAMPLES)) for color in L]
            tables.append(np.stack(colors, axis=-1).reshape(LEVELS, ROWS, COLUMNS, 3))
    radiance, source = tables
    return replace(fog.field, heights=heights, radiance=radiance, source=source)


def scattered_direction(d: mi.Vector3f, g: mi.Float, random: mi.Point2f) -> mi.Vector3f:
    """A direction around ``d``, drawn from the phase function (Witt 1977)."""
    narrow = dr.abs(g) > 1e-3
    root = (1 - g * g) / (1 - g + 2 * g * random.x)
    cosine = (1 + g * g - root * root) / dr.select(narrow, 2 * g, 1)
    cosine = dr.clip(dr.select(narrow, cosine, 2 * random.x - 1), -1, 1)
    sine, (s, c) = dr.safe_sqrt(1 - cosine * cosine), dr.sincos(2 * dr.pi * random.y)
    return mi.Frame3f(d).to_world(mi.Vector3f(sine * c, sine * s, cosine))


@dr.syntax
def _walk(
    scene: mi.Scene,
    around: Surroundings,
    fog: FogLayer,
    sampler: mi.Sampler,
    p: mi.Point3f,
    d: mi.Vector3f,
) -> mi.Color3f:
    """Radiance that arrives at ``p`` from direction ``d``, without the sun's disc."""
    sky, context = around.sky, mi.BSDFContext()
    L, β = mi.Color3f(0), mi.Color3f(1)
    depth, active = mi.UInt32(0), mi.Bool(True)
    while dr.hint(active, max_iterations=DEPTH, label="fog walk"):
        ray = mi.Ray3f(p, d)
        si = scene.ray_intersect(ray, active)
        start, end = fog.interval(ray, si.t)
        s = -dr.log(1 - sampler.next_1d(active)) / fog.sigma_t
        scatters = active & (end > start) & (s < end - start)
        hits = active & ~scatters & si.is_valid()
        escapes = active & ~scatters & ~si.is_valid()
        L += dr.select(escapes, β * sky.radiance(d, escapes), 0)
        bsdf, lives = si.bsdf(ray), scatters | hits
        if dr.hint(sky.has_sun, mode="scalar"):
            to_sun = sky.to_sun(sampler, lives)
            f_sun = bsdf.eval(context, si, si.to_local(to_sun), hits)
            if dr.hint(around.brightest is not None, mode="scalar"):
                f_sun = dr.minimum(f_sun, around.brightest)
            f_sun = dr.select(scatters, fog.albedo * fog.phase(d, to_sun), f_sun)
            to_light = si.spawn_ray(to_sun)
            to_light.o = dr.select(scatters, ray(start + s), to_light.o)
            lit = lives & (dr.max(f_sun) > 0)
            E = sky.sun_irradiance * fog.sun_transmittance(to_light.o.z)
            L += dr.select(lit, β * f_sun * E * pane_transmittance(scene, to_light, lit), 0)
        lobe, across = sampler.next_1d(active), sampler.next_2d(active)
        bs, weight = bsdf.sample(context, si, lobe, across, hits)
        onward = si.spawn_ray(si.to_world(bs.wo))
        β *= dr.select(scatters, fog.albedo, weight)
        p = dr.select(scatters, ray(start + s), onward.o)
        d = dr.select(scatters, scattered_direction(d, fog.asymmetry, across), onward.d)
        survives = dr.select(depth < SURE, 1, dr.minimum(dr.max(β), 0.95))
        active = lives & (dr.max(β) > 0) & (sampler.next_1d(active) < survives)
        β /= dr.select(active, survives, 1)
        depth += 1
    return L
