"""What ``cnca calibrate`` measures in one random scene, from which prices are fitted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from cnca.effects.effect import Model


@dataclass(frozen=True)
class NoiseRecord:
    """Noise of one picture."""

    features: list[float]
    """See :meth:`cnca.effects.subject.Subject.noise_features`."""
    noise: float


@dataclass(frozen=True)
class TimeRecord:
    """Processor seconds of one plan."""

    models: Mapping[str, Model]
    """Effect → model."""
    seconds: float
    """Per million rays."""


@dataclass(frozen=True)
class CaseRecord:
    """What one case tells about the models."""

    features: list[float]
    """See :meth:`cnca.effects.subject.Subject.features`."""
    known: Mapping[str, float]
    """``"effect=model"`` → the share of its error that is a closed form."""
    errors: Mapping[str, float]
    """``"effect=model"`` → error beside the reference; those that the case can tell apart."""
    noise: list[NoiseRecord]
    timed: list[TimeRecord]
