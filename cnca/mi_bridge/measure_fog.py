"""The fog's light in a world: what houses shade and reflect, measured around the vehicle.

Over open ground the light in fog depends on height and direction alone and is solved for
(:mod:`cnca.mi_bridge.fog`).  Among houses random walks through fog and world find it: its radiance
I at the vehicle on a grid of heights and directions, which the phase function p turns into the
source J = ϖ ∫ p I dω, and its differences from place to place,

    J(x, ω) = J(z, ω) max(a₀ + a · ω, 0),

such that the mean of J over all directions, and its mean direction, are those found at the place:
in front of a wall the fog is darker, most of all towards the wall.  The sun's light that is
scattered only once is not in it, nor in the solution: it is known in closed form but for shadows,
which are traced or the probe's.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from jaxtyping import Float

from cnca.mi_bridge.fog import FogField, FogPlaces, henyey_greenstein, level_heights
from cnca.mi_bridge.fog_layer import FogLayer
from cnca.mi_bridge.geometry import Geometry
from cnca.mi_bridge.panes import pane_transmittance
from cnca.mi_bridge.rays import average_samples
from cnca.mi_bridge.surroundings import Surroundings
from cnca.mi_bridge.variant import dr, mi
from cnca.scene.environment import sky_directions, sky_solid_angles

LEVELS, ROWS, COLUMNS, SAMPLES = 8, 16, 24, 64
"""Size of the table, and walks for each of its entries."""
FINER = 3
"""Directions of the radiance that the phase function is applied to, per row and column of it."""
AROUND = 5.0
"""Metres from the vehicle's middle within which the table's walks start."""
NODES, REACH, WALKS = 11, 22.0, 200
"""The grid of places: nodes per side, metres to its outermost ones, walks from each."""
BLUR = 1.0
"""Nodes: standard deviation of the weights with which neighbors count, against their noise."""
PRIOR = 0.02
"""Weight of "as at the vehicle", relative to what is found: it holds where there is no light."""
LOWEST, EYE = 0.05, 1.5
"""Metres above the ground: where walks start at least, and from where their places are seen."""
DEPTH, SURE = 96, 6
"""Most events of a walk, and how many of them come before it may end by chance."""
SEED = 0x2C1B3C6D


def measure_fog(bare: Geometry, around: Surroundings, fog: FogLayer) -> FogField:
    """The light in the fog of a world, around its origin.

    Args:
        bare: the world without the vehicle.
        around: its sky.
        fog: the layer as it lies over open ground.
    """
    heights = level_heights(fog.fog.height, fog.field.stretch, LEVELS)
    with dr.suspend_grad():
        fine = _radiance(bare, around, fog, heights)
        source = fog.fog.albedo * np.einsum("cf,lfx->lcx", _gathering(fog.fog.asymmetry), fine)
        places = _places(bare, around, fog, heights, source.mean(axis=-1))
    radiance = fine.reshape(LEVELS, ROWS, FINER, COLUMNS, FINER, 3).mean(axis=(2, 4))
    source = source.reshape(LEVELS, ROWS, COLUMNS, 3)
    sun = [np.interp(heights, fog.field.heights, color) for color in fog.field.sun.T]
    return replace(
        fog.field,
        heights=heights,
        radiance=radiance,
        source=source,
        sun=np.stack(sun, axis=-1),
        places=places,
    )


def _gathering(asymmetry: float) -> Float[np.ndarray, "coarse fine"]:
    """Phase function times solid angle; rows sum to one, so that even light stays even."""
    rows, columns = ROWS * FINER, COLUMNS * FINER
    fine = sky_directions(rows, columns).reshape(-1, 3)
    cosines = sky_directions(ROWS, COLUMNS).reshape(-1, 3) @ fine.T
    angles = np.broadcast_to(sky_solid_angles(rows, columns), (rows, columns)).ravel()
    matrix = henyey_greenstein(cosines.clip(-1, 1), asymmetry) * angles
    return matrix / matrix.sum(axis=1, keepdims=True)


def _radiance(
    bare: Geometry, around: Surroundings, fog: FogLayer, heights: Float[np.ndarray, " levels"]
) -> Float[np.ndarray, "levels fine 3"]:
    """At the levels above the vehicle's place, from fine directions."""
    rows, columns = ROWS * FINER, COLUMNS * FINER
    samples = -(-SAMPLES // FINER**2)
    lanes = LEVELS * rows * columns * samples
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(dr.opaque(mi.UInt32, SEED), lanes)
    entry = dr.arange(mi.UInt32, lanes) // samples
    texel = entry % (rows * columns)
    across = sampler.next_2d()
    theta = (mi.Float(texel // columns) + across.y) * (np.pi / rows)
    phi = (mi.Float(texel % columns) + across.x) * (2 * np.pi / columns)
    sine, cosine = dr.sincos(theta)
    d = mi.Vector3f(sine * dr.cos(phi), sine * dr.sin(phi), cosine)
    disc = AROUND * mi.warp.square_to_uniform_disk(sampler.next_2d())
    z = dr.gather(mi.Float, mi.Float(np.float32(heights)), entry // (rows * columns))
    p = mi.Point3f(disc.x, disc.y, dr.maximum(z, LOWEST))
    L = _walk(bare.scene, around, fog, sampler, p, d)
    dr.eval(L, sampler)
    colors = [np.array(average_samples(color, samples)) for color in L]
    return np.stack(colors, axis=-1).reshape(LEVELS, rows * columns, 3)


def _places(
    bare: Geometry,
    around: Surroundings,
    fog: FogLayer,
    heights: Float[np.ndarray, " levels"],
    source: Float[np.ndarray, "levels coarse"],
) -> FogPlaces:
    """How the source differs from place to place.

    Walks start all over the cell of a node, where it is seen from above the vehicle's place at the
    same height: inside of houses there is no fog.
    """
    lanes = LEVELS * NODES**2 * WALKS
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(dr.opaque(mi.UInt32, SEED + 1), lanes)
    walk = dr.arange(mi.UInt32, lanes)
    node, level = walk // WALKS, walk // (WALKS * NODES**2)
    d = mi.warp.square_to_uniform_sphere(sampler.next_2d())
    step, jitter = 2 * REACH / (NODES - 1), sampler.next_2d()
    x = (mi.Float(node % NODES) + jitter.x - 0.5) * step - REACH
    y = (mi.Float(node // NODES % NODES) + jitter.y - 0.5) * step - REACH
    z = dr.maximum(dr.gather(mi.Float, mi.Float(np.float32(heights)), level), LOWEST)
    p, axis = mi.Point3f(x, y, z), mi.Point3f(0, 0, dr.maximum(z, EYE))
    to_axis = axis - p
    length = dr.norm(to_axis)
    line = mi.Ray3f(p, to_axis / length, length * 0.999, 0.0, [])
    free = ~bare.scene.ray_test(line)
    L = _walk(bare.scene, around, fog, sampler, mi.Point3f(p), mi.Vector3f(d), free)
    light = dr.select(free, dr.mean(L), 0)
    dr.eval(light, free, d)
    # ∫ J dω and ∫ J ω dω of what each walk finds: scattering keeps g of a direction's mean.
    moments = [light, *(fog.fog.asymmetry * axis * light for axis in d)]
    shape = (LEVELS, NODES, NODES, WALKS)
    sums = np.stack([np.array(m).reshape(shape).sum(axis=-1) for m in moments], axis=-1)
    walks = np.array(free).reshape(shape).sum(axis=-1, dtype=float)
    return FogPlaces(REACH, _fit_places(4 * np.pi * fog.fog.albedo * sums, walks, source))


def _fit_places(
    sums: Float[np.ndarray, "levels nodes nodes 4"],
    walks: Float[np.ndarray, "levels nodes nodes"],
    source: Float[np.ndarray, "levels coarse"],
) -> Float[np.ndarray, "levels nodes nodes 4"]:
    """a₀ and a of all nodes: ∫ J b bᵀ dω a = ∫ J_x b dω, b = (1, ω), J_x the source at a node.

    Args:
        sums: of ∫ J_x b dω over the walks from each node.
        walks: their number; those of a node's neighbors count, too.
    """
    from scipy.ndimage import gaussian_filter  # slow to import, and needed in foggy worlds alone

    directions = sky_directions(ROWS, COLUMNS).reshape(-1, 3)
    angles = np.broadcast_to(sky_solid_angles(ROWS, COLUMNS), (ROWS, COLUMNS)).reshape(-1, 1)
    b = np.concatenate([np.ones((len(directions), 1)), directions], axis=1)
    factors = np.zeros(sums.shape, np.float32)
    nearby = partial(gaussian_filter, sigma=BLUR, mode="constant", axes=(0, 1))
    for level, J in enumerate(source):
        known = (J[:, None] * angles * b).T @ b
        total, count = nearby(sums[level]), nearby(walks[level])[..., None]
        here = np.where(count > 0, total / count.clip(1e-30), known[0])
        prior = max(PRIOR * np.trace(known), 1e-30)
        here[..., 0] += prior
        factors[level] = np.linalg.solve(known + prior * np.eye(4), here[..., None])[..., 0]
    return factors


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
    active: mi.Bool | bool = True,
) -> mi.Color3f:
    """Radiance that arrives at ``p`` from direction ``d``, without the sun's disc."""
    sky, context = around.sky, mi.BSDFContext()
    L, β = mi.Color3f(0), mi.Color3f(1)
    depth, active = mi.UInt32(0), mi.Bool(active)
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
