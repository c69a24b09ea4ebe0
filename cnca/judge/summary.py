"""The outcome of an attack, as records; ``summary.json`` holds them under the same names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated

from pydantic import Field

from cnca.core.records import Omitted


@dataclass(frozen=True, kw_only=True)
class TextureScores:
    """What every texture of a run reaches before one detector, on the held-out views.

    Textures have the names of :data:`cnca.report.MEANING`.  A score is the detection score in
    [0, 1], its mean over the views; None of a texture that the run does not have.
    """

    score_before: Omitted[float] = None
    score_prompt: float
    score_random: Omitted[float] = None
    score_shuffled: float
    score_mirrored: Omitted[float] = None
    score_mean: Omitted[float] = None
    score_seeds: Omitted[float] = None
    score_after: float
    ratio_to_shuffled: float
    """Score of the camouflage over that of its shuffled control."""
    ratio_to_controls: Omitted[float] = None
    """The same over the strongest of all others; runs of the first versions have none."""
    average_precision: Annotated[Mapping[str, float], Field(alias="AP@0.5")]
    scores_per_view: Mapping[str, Sequence[float]]

    def score(self, texture: str) -> float:
        """The mean score of a texture that the run has."""
        return getattr(self, f"score_{texture}")


@dataclass(frozen=True, kw_only=True)
class WeightedScores(TextureScores):
    """The same before one of several detectors."""

    weight: Omitted[float] = None
    """Its part in the loss."""


@dataclass(frozen=True, kw_only=True)
class Summary(TextureScores):
    """The numbers of the first detector, then those of each by its name."""

    prompt: str
    detector: str
    """The first one's name."""
    scene: str
    held_out_views: int
    detectors: Mapping[str, WeightedScores] = field(default_factory=dict)
    """Runs of the first versions have one detector, and nothing here."""
    steps: Omitted[int] = None
    best_step: Omitted[int] = None
    """The step whose latents were kept, in a run with checks."""

    @property
    def by_detector(self) -> Mapping[str, TextureScores]:
        """Name → numbers, of every detector."""
        return self.detectors or {self.detector: self}
