"""What a :mod:`cnca.mi_bridge.probe` keeps of a world, measured by tracing the world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cnca.mi_bridge.geometry import Geometry
from cnca.mi_bridge.integrator import trace
from cnca.mi_bridge.panes import pane_transmittance
from cnca.mi_bridge.probe import Corners, Kept
from cnca.mi_bridge.rays import average_samples
from cnca.mi_bridge.sky import Sky
from cnca.mi_bridge.surroundings import Surroundings
from cnca.mi_bridge.variant import dr, mi

BOUNCES = 3
"""Reflections within the world; the vehicle's own come on top."""
SUN_SAMPLES = 4
"""Rays to the sun from each cell of its map."""
LOWEST = 0.25
"""Metres above the ground that no kerb reaches: from there the sun is looked for."""
SEED = 0x51ED270B


@dataclass(frozen=True)
class Resolution:
    """How finely the world is looked at."""

    rows: int
    columns: int
    samples: int
    """Paths for each direction."""
    sun_cells: int
    """Cells per side of the sun's map."""
    half_width: float
    """Metres: half a side of the sun's map."""


PANORAMA = Resolution(96, 192, 32, 512, 14.0)
"""Directions 1.9° and shadows 5 cm wide; the near ground lies within."""
METER = Resolution(16, 32, 64, 32, 2.0)
"""What an exposure meter needs; the sun's map covers the vehicle alone."""


def measure(
    bare: Geometry, around: Surroundings, box: Corners, resolution: Resolution = PANORAMA
) -> Kept:
    """Look at the world without the vehicle from the middle of where it will stand.

    Args:
        bare: the world alone.
        around: its sky and fog.
        box: the vehicle's lowest and highest corner.
    """
    low, high = box
    middle = (low + high) / 2
    frame = _frame(np.array(around.sky.light.sun_direction))
    shares = np.ones((1, 1, 2), np.float32)
    if around.sky.has_sun:
        shares = _sun_shares(bare, around.sky, box, frame, resolution)
    radiance = panorama(bare, around, middle, resolution)
    return Kept(radiance, shares, box, resolution.half_width, frame)


def panorama(
    bare: Geometry,
    around: Surroundings,
    point: Float[np.ndarray, "3"],
    resolution: Resolution,
) -> Float[np.ndarray, "rows columns 3"]:
    """Radiance at a point from every direction, without the sun's disc."""
    rows, columns, samples = resolution.rows, resolution.columns, resolution.samples
    lanes = rows * columns * samples
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(dr.opaque(mi.UInt32, SEED), lanes)
    texel = dr.arange(mi.UInt32, lanes) // samples
    jitter = sampler.next_2d()
    theta = (mi.Float(texel // columns) + jitter.y) * (np.pi / rows)
    phi = (mi.Float(texel % columns) + jitter.x) * (2 * np.pi / columns)
    sine, cosine = dr.sincos(theta)
    d = mi.Vector3f(sine * dr.cos(phi), sine * dr.sin(phi), cosine)
    origin = mi.Point3f(*point.tolist())
    dr.make_opaque(origin)
    ray = mi.Ray3f(origin, d)
    first = [sampler.next_1d() for _ in range(3)]
    with dr.suspend_grad():
        L, _ = trace(bare.scene, around, sampler, ray, first, bounces=BOUNCES, reflected=True)
        dr.eval(L)
        colors = [np.array(average_samples(color, samples)) for color in L]
    return np.stack(colors, axis=-1).reshape(rows, columns, 3)


def _frame(sun: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    across = np.cross(sun, np.eye(3)[np.abs(sun).argmin()])
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(sun, across), sun])


def _sun_shares(
    bare: Geometry, sky: Sky, box: Corners, frame: Float[np.ndarray, "3 3"], resolution: Resolution
) -> Float[np.ndarray, "size size 2"]:
    """What passes along each line to the sun: from the vehicle's box onward, and from the ground.

    What stands between ground and box on such a line shades the ground alone.
    """
    low, high = box
    middle, (across, along, sun) = (low + high) / 2, frame
    cells, half = resolution.sun_cells, resolution.half_width
    lanes = cells**2 * SUN_SAMPLES
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(dr.opaque(mi.UInt32, SEED), lanes)
    cell = dr.arange(mi.UInt32, lanes) // SUN_SAMPLES
    jitter = sampler.next_2d()
    scale = 2 * half / cells
    a = (mi.Float(cell % cells) + jitter.x) * scale - half
    b = (mi.Float(cell // cells) + jitter.y) * scale - half
    p = _vector(middle) + a * _vector(across) + b * _vector(along)
    s = _vector(sun)
    from_ground = (LOWEST - p.z) / dr.maximum(s.z, 1e-3)
    # Where the line leaves the box, from slabs; those that miss it begin above the ground.
    slope = dr.rcp(dr.select(dr.abs(s) < 1e-6, 1e-6, s))
    t0, t1 = (_vector(low) - p) * slope, (_vector(high) - p) * slope
    enters, leaves = dr.max(dr.minimum(t0, t1)), dr.min(dr.maximum(t0, t1))
    from_box = dr.select(enters < leaves, dr.maximum(leaves, from_ground), from_ground)
    shares = []
    for start in (from_box, from_ground):
        ray = mi.Ray3f(p + start * s, sky.to_sun(sampler, mi.Bool(True)))
        share = pane_transmittance(bare.scene, ray, mi.Bool(True)).x
        dr.eval(share)
        shares.append(np.array(average_samples(share, SUN_SAMPLES)))
    return np.stack(shares, axis=-1).reshape(cells, cells, 2)


def _vector(values: Float[np.ndarray, "3"]) -> mi.Vector3f:
    vector = mi.Vector3f(*np.asarray(values, float).tolist())
    dr.make_opaque(vector)
    return vector
