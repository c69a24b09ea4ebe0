"""Confidence intervals over views (Efron's percentile bootstrap).

Every number that is estimated from the same views is computed for the same resamples of them, so
that the difference of two numbers has an interval of its own, narrower than theirs: the views that
are hard for one texture are mostly hard for the other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from cnca.judge.records import Estimate

RESAMPLES = 1000
LEVEL = 0.95


def resample(
    strata: Sequence[int], *, seed: int, count: int = RESAMPLES
) -> Float[Tensor, "samples views"]:
    """How often each view is counted: once in row 0, then as drawn with replacement.

    ``strata`` holds the number of views of each scene; a scene keeps its number in every resample.
    """
    rng = np.random.default_rng(seed)
    drawn = [rng.multinomial(size, np.full(size, 1 / size), size=count) for size in strata]
    once = np.ones((1, sum(strata)))
    return torch.from_numpy(np.concatenate([once, np.concatenate(drawn, axis=1)]).astype(float))


@dataclass(frozen=True)
class Sampled:
    """A number and how it varies over resamples of the views."""

    samples: Float[Tensor, " samples"]
    """The number itself first; NaN where a resample leaves it undefined."""

    @property
    def value(self) -> float:
        """The number over all views; NaN where it is undefined."""
        return float(self.samples[0])

    def interval(self) -> tuple[float, float]:
        """The 2.5th and the 97.5th percentile over the resamples; NaN where undefined."""
        tail = (1 - LEVEL) / 2
        drawn = self.samples[1:]
        low, high = torch.nanquantile(drawn, torch.tensor([tail, 1 - tail], dtype=drawn.dtype))
        return float(low), float(high)

    def __sub__(self, other: Sampled) -> Sampled:
        return Sampled(self.samples - other.samples)

    def estimate(self) -> Estimate:
        """The value and its interval to four digits, None where undefined."""
        return Estimate(*(_rounded(number) for number in (self.value, *self.interval())))


def _rounded(number: float) -> float | None:
    return None if math.isnan(number) else round(number, 4)


def mean(numbers: Sequence[Sampled]) -> Sampled:
    """The mean of several numbers over the same resamples."""
    return Sampled(torch.stack([number.samples for number in numbers]).mean(dim=0))
