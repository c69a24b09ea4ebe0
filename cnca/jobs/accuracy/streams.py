"""Pixels whose rays come in two independent streams: their mean is the picture, their difference
its noise.

Each stream goes on in one evenly spread set of rays, so many at a time; a pixel may get more of
them than its neighbor.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from cnca.jobs.accuracy.fidelity import Pixels, weight

Draw = Callable[[Int[np.ndarray, " chosen"], int, int], Pixels]
"""(which pixels, seed, number of the first ray) → mean of the next rays of each."""

Squares = Float[np.ndarray, " pixels"]
"""One number for each pixel, of the square of a relative error."""


class Streams:
    """Sums over the rays of some pixels of one picture."""

    def __init__(
        self,
        draw: Draw,
        pixels: Int[np.ndarray, " pixels"],
        *,
        rays: int,
        seeds: tuple[int, int],
    ) -> None:
        """
        Args:
            pixels: counted over rows and columns.
            rays: of a pixel in one step of one stream.
            seeds: of the streams.
        """
        self.draw, self.pixels, self.rays, self.seeds = draw, pixels, rays, seeds
        self.steps = np.zeros(len(pixels), dtype=np.int64)
        """That each stream has taken at each pixel."""
        self._sums = np.zeros((2, len(pixels), 3))

    def add(self, more: Int[np.ndarray, " pixels"]) -> None:
        """Take so many more steps at each pixel; those that are equally far go together."""
        more = more.copy()
        while (more > 0).any():
            done = int(self.steps[more > 0].min())
            chosen = np.flatnonzero((more > 0) & (self.steps == done))
            for sums, seed in zip(self._sums, self.seeds, strict=True):
                sums[chosen] += self.draw(self.pixels[chosen], seed, done * self.rays)
            self.steps[chosen] += 1
            more[chosen] -= 1

    def advance(self, steps: int) -> None:
        """Take so many more steps at every pixel."""
        self.add(np.full(len(self.pixels), steps))

    @property
    def halves(self) -> tuple[Pixels, Pixels]:
        """The mean of each stream."""
        first, second = self._sums / self.steps[:, None]
        return first, second

    @property
    def mean(self) -> Pixels:
        """The picture."""
        first, second = self.halves
        return (first + second) / 2

    def noise(self) -> Squares:
        """Squared relative noise of the mean at each pixel, over colors.

        It is relative to something between arithmetic and harmonic mean of both halves: a speck in
        one of them would make its pixel look bright, and so its own error small.
        """
        first, second = self.halves
        harmonic = 2 * first * second / np.maximum(first + second, 1e-12)
        squares = (first - second) ** 2 / 4 * weight((self.mean, harmonic))
        return np.asarray(squares.mean(axis=1))

    @property
    def rays_spent(self) -> int:
        """Of all pixels and both streams."""
        return int(2 * self.rays * self.steps.sum())
