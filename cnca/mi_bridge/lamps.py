"""Lamps as kernels sample them: one for each surface that a path meets, drawn by its light there.

A street has dozens, of which few light a given point.  So the ground plan is divided into cells,
and each has a table of how much light every lamp would throw into it if nothing stood between.
All emitters that Mitsuba knows can be lamps: glowing surfaces, spots and points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cnca.mi_bridge.opaque import opaque_float
from cnca.mi_bridge.variant import dr, mi

HALF, CELLS = 100.0, 40
"""Metres from the middle to the sides of the plan, and its cells per side; the outermost ones hold
what lies beyond."""
HEIGHTS = (0.1, 1.5, 5.0)
"""Metres above the ground at which lamps are compared."""
EVEN = 0.2
"""Part of the samples that all lamps share alike, for points that the tables misjudge."""


@dataclass
class LampSample:
    """Light of one lamp at a surface."""

    d: mi.Vector3f
    """Unit vector towards it."""
    p: mi.Point3f
    """The point of the lamp that was drawn."""
    irradiance: mi.Color3f
    """On a surface that faces it, over the probability of having drawn it; without shadows."""
    density: mi.Float
    """Per steradian; 0 for a lamp that no ray can meet."""


class Lamps:
    """Emitters of a scene that are sampled; other surfaces that emit are met by chance."""

    def __init__(
        self,
        scene: mi.Scene,
        emitters: Sequence[mi.Emitter],
        gain: float,
        shares: Float[np.ndarray, " lamps"] | None = None,
    ) -> None:
        """
        Args:
            emitters: those of the scene that are sampled, at least one.
            gain: factor on what they, and all other emitters of the scene, emit.
            shares: how much of each one's light gets through a world that is not traced.
        """
        self.scene, self.count = scene, len(emitters)
        # A power of two, so that another number of lamps seldom needs another kernel.
        self._slots = 1 << (self.count - 1).bit_length()
        self._gain = opaque_float(gain)
        self._emitters = mi.EmitterPtr(list(emitters))
        self._numbers = _numbers(self._emitters, self._slots)
        self._shares = None if shares is None else mi.Float(np.float32(shares))
        weights = self._weights()
        total = weights.sum(axis=1, keepdims=True)
        even = np.full_like(weights, 1 / self.count)
        chances = (1 - EVEN) * np.where(total > 0, weights / np.maximum(total, 1e-30), even)
        chances = np.pad(chances + EVEN * even, ((0, 0), (0, self._slots - self.count)))
        self._chances = mi.Float(np.float32(chances).ravel())
        sums = np.cumsum(chances, axis=1)
        self._sums = mi.Float(np.float32(sums / sums[:, -1:]).ravel())
        dr.eval(self._emitters, self._numbers)

    def sample(
        self, si: mi.SurfaceInteraction3f, lobe: mi.Float, across: mi.Point2f, active: mi.Bool
    ) -> LampSample:
        """Draw a lamp, and a point of it, for each surface."""
        first = self._cell(si.p) * self._slots
        last = self._slots - 1
        number = dr.binary_search(
            0, last, lambda i: dr.gather(mi.Float, self._sums, first + i, active) < lobe
        )
        chance = dr.gather(mi.Float, self._chances, first + number, active)
        drawn = self.look(si, number, across, active)
        drawn.irradiance /= chance
        drawn.density *= chance
        return drawn

    def look(
        self,
        si: mi.Interaction3f,
        number: mi.UInt32,
        across: mi.Point2f,
        active: mi.Bool | bool = True,
    ) -> LampSample:
        """A point of the lamp with that number."""
        active = mi.Bool(active)
        emitter = dr.gather(mi.EmitterPtr, self._emitters, number, active)
        ds, light = emitter.sample_direction(si, across, active)
        irradiance = mi.Color3f(light) * self._factor(number, active)
        return LampSample(ds.d, ds.p, irradiance, dr.select(ds.delta, 0, ds.pdf))

    def seen(
        self,
        si: mi.SurfaceInteraction3f,
        start: mi.Point3f,
        density: mi.Float,
        hidden: mi.Bool,
        active: mi.Bool,
    ) -> mi.Color3f:
        """What a surface that a ray meets emits towards it.

        Args:
            start: where the ray began.
            density: with which it was drawn, per steradian, at a surface that samples lamps, too; 0
                where no such surface drew it, and all light counts.
            hidden: rays from surfaces that leave all light of lamps to their own samples.
        """
        emitter = si.emitter(self.scene, active)
        L = mi.Color3f(emitter.eval(si, active))
        index = dr.reinterpret_array(mi.UInt32, emitter)
        known = active & (index < dr.width(self._numbers))
        number = dr.gather(mi.UInt32, self._numbers, index, known)
        sampled = known & (number < self._slots)
        from_there = dr.zeros(mi.Interaction3f)
        from_there.p = start
        ds = mi.DirectionSample3f(self.scene, si, from_there)
        slot = self._cell(start) * self._slots + number
        chance = dr.gather(mi.Float, self._chances, slot, sampled)
        other = emitter.pdf_direction(from_there, ds, sampled) * chance
        weight = dr.select(density > 0, density / (density + other), 1)
        factor = dr.select(sampled, self._factor(number, sampled) * weight, self._gain)
        return dr.select(active & ~(sampled & hidden), L * factor, 0)

    def light_at(
        self, points: Float[np.ndarray, "points 3"], samples: int = 1
    ) -> Float[np.ndarray, "points lamps"]:
        """Irradiance on surfaces that face each lamp, mean of the colors; only ``shares`` shade."""
        lanes = len(points) * self.count
        lane = dr.arange(mi.UInt32, lanes)
        si = dr.zeros(mi.Interaction3f, lanes)
        flat = mi.Float(np.float32(points).ravel())
        si.p = dr.gather(mi.Point3f, flat, lane // self.count)
        total = mi.Float(0)
        for i in range(samples):
            across = mi.Point2f((i + 0.5) / samples, (i * 0.618 + 0.5) % 1)
            total += dr.mean(self.look(si, lane % self.count, across).irradiance) / samples
        return np.array(total).reshape(len(points), self.count)

    def _weights(self) -> Float[np.ndarray, "cells lamps"]:
        """Light of each lamp in each cell: root mean square over points, which finds beams, too."""
        edge = 2 * HALF / CELLS
        middles = (np.arange(CELLS) + 0.5) * edge - HALF
        offsets = np.array([-edge / 3, 0.0, edge / 3])
        y, x, b, a, z = np.meshgrid(middles, middles, offsets, offsets, HEIGHTS, indexing="ij")
        points = np.stack([x + a, y + b, z], axis=-1).reshape(-1, 3)
        light = self.light_at(points, samples=2).reshape(CELLS * CELLS, -1, self.count)
        return np.sqrt(np.square(light).mean(axis=1))

    def _cell(self, p: mi.Point3f) -> mi.UInt32:
        at = (mi.Point2f(p.x, p.y) + HALF) * (CELLS / (2 * HALF))
        cell = mi.Point2u(dr.clip(at, 0, CELLS - 1))
        return cell.y * CELLS + cell.x

    def _factor(self, number: mi.UInt32, active: mi.Bool) -> mi.Float:
        if self._shares is None:
            return self._gain
        return self._gain * dr.gather(mi.Float, self._shares, number, active)


def _numbers(emitters: mi.EmitterPtr, none: int) -> mi.UInt32:
    """Mitsuba's number of an emitter → its number among the lamps, or ``none``."""
    indices = np.array(dr.reinterpret_array(mi.UInt32, emitters))
    table = np.full(int(indices.max()) + 1, none, np.uint32)
    table[indices] = np.arange(len(indices))
    return mi.UInt32(table)
