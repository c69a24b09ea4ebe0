"""Camera rays of several views in one wavefront, and the averaging of samples to pixels.

Lanes run over (view, row, column, sample), sample fastest; one film and one kernel serve all views.
Of the pixels some may be chosen: lanes then run over (pixel, sample).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Int

from cnca.core.errors import SceneError
from cnca.mi_bridge.variant import dr, mi
from cnca.scene.cameras import View

GOLDEN_5 = 1.13472413840151949
"""Root of x⁶ = x + 1: its inverse powers spread points evenly in five dimensions (Roberts 2018)."""
DIMENSIONS = 5
"""Evenly spread numbers per lane: two for the pixel, three for the first reflection."""
HASH_ROUNDS = 8
"""With Mitsuba's usual 4 a pixel's dimensions correlate: ground at dusk came out 1.4 % too dark."""


class Cameras:
    """Pin-hole cameras with a common picture size, as arrays that kernels read from memory."""

    def __init__(
        self, views: Sequence[View], pixels: Int[np.ndarray, " pixels"] | None = None
    ) -> None:
        """
        Args:
            pixels: the only ones to look through, counted over views, rows and columns.

        Raises:
            SceneError: there is no view, or the picture sizes differ.
        """
        sizes = {(view.width, view.height) for view in views}
        if len(sizes) != 1:
            raise SceneError(f"views rendered together need one picture size, got {sorted(sizes)}")
        ((self.width, self.height),) = sizes
        self.count = len(views)
        frames = np.array([_camera_frame(view) for view in views], dtype=np.float32)
        # (views, 4 vectors, 3 axes).  A list, for Dr.Jit's own memory: recorded kernels
        # (live.py) expect arrays aligned as when recorded, and NumPy's may lie anywhere.
        self.frames = mi.Float(frames.ravel().tolist())
        self.names = [view.name for view in views]
        self._chosen = pixels
        self._pixels = None if pixels is None else mi.UInt32(pixels.astype(np.uint32))
        whole = (self.count, self.height, self.width)
        self.film_shape = whole if pixels is None else (len(pixels),)

    def rays(
        self, samples: int, seed: mi.UInt32 | None = None, first: int | mi.UInt32 = 0
    ) -> tuple[mi.Ray3f, list[mi.Float]]:
        """One ray per lane, and three numbers in [0, 1) that continue its even spread.

        A pixel's lanes form one low-discrepancy set, shifted at random.  Without a seed the set is
        the same in each pixel and starts at its centre.  It begins with its point ``first``.
        """
        lane = dr.arange(mi.UInt32, self.lanes(samples))
        if isinstance(first, int):
            first = dr.opaque(mi.UInt32, first)
        pixel, sample = lane // samples, lane % samples + first
        if self._pixels is not None:
            pixel = dr.gather(mi.UInt32, self._pixels, pixel)
        row_index, column = pixel // self.width, pixel % self.width
        view, row = row_index // self.height, row_index % self.height
        spread = []
        for dimension in range(DIMENSIONS):
            shift = mi.Float(0.5)
            if seed is not None:
                shift = mi.sample_tea_float32(pixel * DIMENSIONS + dimension, seed, HASH_ROUNDS)
            value = shift + mi.Float(sample) * GOLDEN_5 ** -(dimension + 1)
            spread.append(value - dr.floor(value))
        x = 2 * (mi.Float(column) + spread[0]) / self.width - 1
        y = 1 - 2 * (mi.Float(row) + spread[1]) / self.height
        origin, right, up, forward = (
            dr.gather(mi.Vector3f, self.frames, 4 * view + vector) for vector in range(4)
        )
        ray = mi.Ray3f(mi.Point3f(origin), dr.normalize(forward + x * right + y * up))
        return ray, spread[2:]

    def name_of(self, row: int) -> str:
        """The view to which row ``row`` of the film belongs: a picture or a chosen pixel."""
        chosen = self._chosen
        return self.names[row if chosen is None else chosen[row] // (self.height * self.width)]

    def lanes(self, samples: int) -> int:
        """Wavefront size for that many samples per pixel."""
        return math.prod(self.film_shape) * samples


def average_samples(values: mi.Float, samples: int) -> mi.Float:
    """Mean over the samples of each pixel (a box filter of one pixel)."""
    return dr.block_sum(values, samples) / samples


def _camera_frame(view: View) -> np.ndarray:
    """Origin, right and up (scaled to the picture's half size at distance 1), forward."""
    origin, target = np.array(view.origin), np.array(view.target)
    distance = np.linalg.norm(target - origin)
    if not distance > 0:
        raise SceneError(f"camera {view.name}: its target is its own position {view.origin}")
    forward = (target - origin) / distance
    right = np.cross(forward, view.up)
    if np.linalg.norm(right) < 1e-9:
        raise SceneError(f"camera {view.name}: looks along its up vector {view.up}")
    right /= np.linalg.norm(right)
    half_width = np.tan(np.radians(view.fov) / 2)
    half_height = half_width * view.height / view.width
    return np.stack([origin, right * half_width, np.cross(right, forward) * half_height, forward])
