"""How much light of a world's lamps reaches the vehicle: measured once, kept beside its probe.

Each lamp has one number, the share of its light that gets through the world to the vehicle and the
road around it.  Neglected: that a post or a parked car shades only a part of these, and lamps that
together add less than :data:`LEAST` of the light there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from cnca.mi_bridge.geometry import Geometry
from cnca.mi_bridge.lamps import Lamps
from cnca.mi_bridge.panes import pane_transmittance
from cnca.mi_bridge.probe import Corners
from cnca.mi_bridge.variant import dr, mi
from cnca.scene.environment import sky_solid_angles

SAMPLES = 256
"""Rays to each lamp."""
AROUND = 1.5
"""Metres around the vehicle's box in which they start."""
LEAST = 0.01
SEED = 0x1A3B


@dataclass(frozen=True)
class KeptLamps:
    """Lamps of a world as the vehicle sees them."""

    shares: Float[np.ndarray, " lamps"]
    """Share of their light that nothing blocks, in [0, 1]."""
    towards: Float[np.ndarray, "lamps 3"]
    """Unit vectors from the vehicle's middle."""
    irradiance: Float[np.ndarray, "lamps 3"]
    """On surfaces that face them, shadows counted."""

    @property
    def needed(self) -> Bool[np.ndarray, " lamps"]:
        """Which ones add more than :data:`LEAST` of the light, the weakest left out."""
        light = self.irradiance.mean(axis=1)
        order = np.argsort(light)
        weak = np.cumsum(light[order]) <= LEAST * light.sum()
        needed = np.ones(len(light), bool)
        needed[order[weak]] = False
        return needed

    def as_sky(self, rows: int, columns: int) -> Float[np.ndarray, "rows columns 3"]:
        """Radiance of a sky that holds each lamp in one texel."""
        sky = np.zeros((rows, columns, 3))
        x, y, z = self.towards.T
        row = (np.arccos(z.clip(-1, 1)) / np.pi * rows).astype(int).clip(0, rows - 1)
        column = (np.arctan2(y, x) / (2 * np.pi) % 1 * columns).astype(int) % columns
        np.add.at(sky, (row, column), self.irradiance)
        return sky / sky_solid_angles(rows, columns)[..., None]

    def white(self) -> float:
        """Radiance of white card in their light, the mean of one lying flat and of upright ones."""
        light = self.irradiance.mean(axis=1)
        x, y, z = self.towards.T
        flat = (light * z.clip(min=0)).sum()
        upright = np.mean([(light * side.clip(min=0)).sum() for side in (x, -x, y, -y)])
        return float(flat + upright) / 2 / np.pi


def measure_lamps(bare: Geometry, lamps: Lamps, box: Corners) -> KeptLamps:
    """Look at each lamp of a world without the vehicle from all around where it will stand."""
    low, high = box[0] - [AROUND, AROUND, 0], box[1] + [AROUND, AROUND, 0]
    lanes = lamps.count * SAMPLES
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(dr.opaque(mi.UInt32, SEED), lanes)
    random = [sampler.next_1d() for _ in range(3)]
    sides = zip(random, low.tolist(), (high - low).tolist(), strict=True)
    si = dr.zeros(mi.SurfaceInteraction3f, lanes)
    si.p = mi.Point3f(*(start + share * side for share, start, side in sides))
    si.p.z = dr.maximum(si.p.z, 0.1)
    sample = lamps.look(si, dr.arange(mi.UInt32, lanes) // SAMPLES, sampler.next_2d())
    seen = sample.irradiance * pane_transmittance(
        bare.scene, si.spawn_ray_to(sample.p), dr.max(sample.irradiance) > 0, sample.p
    )
    dr.eval(sample, seen)
    shape = (3, lamps.count, SAMPLES)
    whole, free = (np.array(E).reshape(shape).mean(axis=2).T for E in (sample.irradiance, seen))
    towards = np.array(sample.p).reshape(shape).mean(axis=2).T - (box[0] + box[1]) / 2
    towards /= np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-6)
    shares = free.mean(axis=1) / np.maximum(whole.mean(axis=1), 1e-30)
    return KeptLamps(shares.clip(0, 1), towards, free)
