"""The outcome of an evaluation, as records; ``results.json`` holds them under the same names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from cnca.core.records import Omitted


@dataclass(frozen=True)
class Estimate:
    """A number with its 95 % interval; None where it is undefined."""

    value: float | None
    low: float | None
    high: float | None


Scores = Mapping[str, Mapping[str, Mapping[str, Mapping[str, Estimate]]]]
"""Texture → detector (or ``total``) → column → measure → estimate."""


@dataclass(frozen=True)
class Comparison(Estimate):
    """The AP@0.5 (VOC, area) of one texture less that of another, over the same views."""

    candidate: str
    control: str
    detector: str
    verdict: str
    """See :func:`cnca.judge.verdict.word_for`."""


@dataclass(frozen=True)
class SectionScores:
    """The views that are alike in one axis, and what every texture reaches in them."""

    label: str
    place: float | None
    """The middle of their values; None for clear air."""
    views: int
    AP_voc: Mapping[str, Estimate]
    """Texture → AP@0.5, mean over the detectors."""


@dataclass(frozen=True)
class OutlineDistance:
    """How far the drawn and the photographed outline lie apart, in pixels."""

    median: float
    percentile_90: float

    def rounded(self) -> OutlineDistance:
        """To hundredths of a pixel."""
        return OutlineDistance(round(self.median, 2), round(self.percentile_90, 2))


@dataclass(frozen=True)
class FrameFit:
    """How well the vehicle's mesh meets a photographed frame."""

    frame: str
    used: bool
    lift: Omitted[float] = None
    """Metres."""
    outline_pixels: Omitted[OutlineDistance] = None
    problem: Omitted[str] = None
    """Why there is no fit."""


@dataclass(frozen=True)
class Evidence:
    """All numbers of an evaluation of textures in rendered scenes."""

    views: int
    interval: str
    """What the intervals are."""
    seed: int
    scenes: Sequence[str]
    detectors: Sequence[str]
    candidates: Sequence[str]
    rows: Sequence[str]
    """Textures, the candidates among them, in the order of the tables."""
    measures: Mapping[str, str]
    """Name → meaning."""
    all: Scores
    comparisons: Sequence[Comparison]
    sections: Mapping[str, Sequence[SectionScores]]
    """Axis → its sections."""
    frames: Omitted[Sequence[FrameFit]] = None
    by_scene: Omitted[Mapping[str, Scores]] = None
    """Where there are several scenes."""
    label: str = "car"
    """What the vehicle is, and the column that its class has."""


@dataclass(frozen=True)
class PhotoEvidence:
    """All numbers of an evaluation on photographs."""

    photos: Mapping[str, int]
    """Group → how many photographs it has."""
    interval: str
    seed: int
    rows: Sequence[str]
    """The groups, in the order of the tables."""
    detectors: Sequence[str]
    all: Scores
    comparisons: Sequence[Comparison]
