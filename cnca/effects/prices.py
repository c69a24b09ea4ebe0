"""What each model costs: its error and its time, predicted from measurements.

``cnca calibrate`` renders random scenes with and without each model and fits

    error(model) = share(model, subject) · exp(w · x(subject) + spread).

``share`` is a closed form where there is one (the share of light that fog takes), x the subject's
features, and ``spread`` the residual that nine of ten scenes stay under: predictions err upwards.
The fit ships as ``assets/prices.json``.

An error is √mean((L − L_ref)² / (L_ref² + 0.01)) over the vehicle's pixels, L exposed linear RGB:
relative to bright pixels, absolute in dark ones (relMSE of Rousselle, Knaus & Zwicker 2011).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from cnca.core.records import read_record
from cnca.effects.subject import TYPICAL, Subject

SHIPPED = Path(__file__).parents[1] / "assets" / "prices.json"
QUANTILE = 0.9


@dataclass(frozen=True)
class Fit:
    """One model's error as a function of the features."""

    weights: tuple[float, ...]
    spread: float

    def error(self, features: Sequence[float]) -> float:
        """exp(w · x + spread)."""
        return math.exp(
            sum(w * x for w, x in zip(self.weights, features, strict=True)) + self.spread
        )


def fit(features: Sequence[Sequence[float]], errors: Sequence[float]) -> Fit:
    """Least squares in the logarithm with a slight pull to a constant; all errors > 0."""
    x, y = np.asarray(features, dtype=np.float64), np.log(errors)
    pull = np.sqrt(0.3) * np.eye(x.shape[1])[1:]
    rows, values = np.vstack([x, pull]), np.concatenate([y, np.zeros(len(pull))])
    weights = np.linalg.lstsq(rows, values, rcond=None)[0]
    spread = max(float(np.quantile(y - x @ weights, QUANTILE)), 0.0)
    return Fit(tuple(round(float(w), 4) for w in weights), round(spread, 4))


@dataclass(frozen=True)
class Prices:
    """Fits of all models that have an error, of the noise, and the time of each model."""

    errors: Mapping[str, Fit]
    """``"effect=model"`` → error beside the reference's model; others have none."""
    noise: Fit
    """Of :meth:`Subject.noise_features`."""
    seconds: Mapping[str, float]
    """``"effect=model"`` → seconds per million rays; ``"rays"`` is what every ray costs."""

    def noise_of(self, samples: int, subject: Subject) -> float:
        """Predicted noise of that many rays per pixel."""
        return self.noise.error(subject.noise_features(samples))

    def samples_for(self, noise: float, subject: Subject, most: int) -> int:
        """Rays per pixel for that noise: a power of two, whose kernels are used again."""
        ratio = self.noise_of(TYPICAL, subject) / max(noise, 1e-9)
        wanted = TYPICAL * ratio ** (-1 / self.noise.weights[-1])
        return int(min(2 ** max(math.ceil(math.log2(wanted)), 0), most))


@dataclass(frozen=True)
class Calibration:
    """The content of a ``prices.json``: prices, and how they were measured."""

    made_by: str
    """The commands."""
    pixels: tuple[int, ...]
    """Per side, of the pictures that are compared and of the larger ones of the noise."""
    samples: tuple[int, ...]
    """Rays per pixel of both halves."""
    versions: Mapping[str, str]
    prices: Prices


@cache
def shipped_calibration() -> Calibration:
    """The one that comes with the package."""
    return read_record(Calibration, SHIPPED)


def shipped_prices() -> Prices:
    """The prices that come with the package."""
    return shipped_calibration().prices
