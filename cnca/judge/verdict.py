"""From what detectors saw to numbers with intervals, and whether a difference is one.

Everything is estimated over the same resamples of the views (see :mod:`cnca.judge.bootstrap`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from cnca.core.detections import ALARM, FAINTEST_SCORE, LEAST_SCORE
from cnca.core.types import Detections
from cnca.detect.classes import CAR, counted, vehicle_labels
from cnca.judge.bootstrap import Sampled, mean
from cnca.judge.protocols import measure_by_protocols
from cnca.judge.records import Scores
from cnca.judge.scores import Kind, as_one_class, best_scores, rank
from cnca.judge.truth import Truth

MEASURES = {
    "AP_voc": "AP@0.5, Pascal VOC 2010–2012 (area)",
    "AP_voc11": "AP@0.5, Pascal VOC 2007 (11 points)",
    "AP_coco": "AP@0.5, COCO (101 points)",
    "score": "mean detection score",
    "success": "attack success rate",
}
KINDS: tuple[Kind, ...] = ("voc", "voc11", "coco")
LEAST_VIEWS = 20
"""Where all of so many views are alike, up to 3 / 20 of all others may still differ (at 95 %)."""
TOO_FEW = "too few views"
TOTAL = "total"

Weights = Float[Tensor, "samples views"]
Measured = Mapping[str, Sampled]
MeasuredScores = Mapping[str, Mapping[str, Mapping[str, Measured]]]
"""Texture → detector (or ``total``) → column → measure → number over all resamples."""


@dataclass(frozen=True)
class Seen:
    """What one detector reported over all views."""

    detections: Sequence[Detections]
    class_names: Sequence[str]
    label: str = CAR
    """What the vehicle is."""

    @property
    def columns(self) -> tuple[str, ...]:
        """The vehicle's class, and ``vehicle``; see :func:`cnca.detect.classes.counted`."""
        return tuple(counted(self.label))

    def column(self, name: str, least: float = LEAST_SCORE) -> list[Detections]:
        """The detections that count in a column, as class 0, from the confidence ``least`` on.

        Raises DetectorError where the detector does not know the vehicle's class.
        """
        labels = vehicle_labels(self.class_names, self.label)[name]
        return [as_one_class(detections.above(least), labels) for detections in self.detections]


def measure(
    seen: Seen, before: Seen | None, truth: Truth, weights: Weights, column: str
) -> Measured:
    """All :data:`MEASURES` of one texture before one detector.

    ``before`` is what the same detector saw of the normal paint in the same views; without it there
    is no attack success rate, the share of the views with a vehicle found before (confidence of at
    least :data:`ALARM`, IoU of at least 0.5) in which it is no longer found.  The measures of
    :mod:`cnca.judge.protocols` are of the vehicle's own class alone.
    """
    detections = seen.column(column)
    truths, ignored = truth.objects(column, seen.label), truth.ignored(column, seen.label)
    rankings = {kind: rank(detections, truths, 0, kind=kind, ignored=ignored) for kind in KINDS}
    measured: dict[str, Sampled] = {
        f"AP_{kind}": Sampled(ranking.average_precision(weights))
        for kind, ranking in rankings.items()
    }
    scores = best_scores(detections, truth.boxes)
    measured["score"] = Sampled(weights @ scores / weights.sum(dim=1))
    if before is not None:
        had = (best_scores(before.column(column), truth.boxes) >= ALARM).double()
        lost = had * (scores < ALARM)
        measured["success"] = Sampled((weights @ lost) / (weights @ had))  # 0 / 0 is NaN
    if column == seen.label:
        faint = seen.column(column, FAINTEST_SCORE)
        clean = faint if before is None else before.column(column, FAINTEST_SCORE)
        measured |= measure_by_protocols(faint, clean, truth, weights, column, seen.label)
    return measured


def measure_all(
    seen: Mapping[str, Mapping[str, Seen]], truth: Truth, weights: Weights, *, normal: str
) -> MeasuredScores:
    """Every measure of every texture; ``total`` is the mean over the detectors.

    ``seen`` maps texture → detector → what it saw; ``normal`` names the texture that all others are
    compared with in the attack success rate.
    """
    table: dict[str, dict[str, dict[str, Measured]]] = {}
    for texture, by_detector in seen.items():
        table[texture] = {}
        for detector, observed in by_detector.items():
            before = None if texture == normal else seen[normal][detector]
            table[texture][detector] = {
                column: measure(observed, before, truth, weights, column)
                for column in observed.columns
            }
        tables = list(table[texture].values())
        table[texture][TOTAL] = {
            column: {name: mean([t[column][name] for t in tables]) for name in tables[0][column]}
            for column in tables[0]
        }
    return table


def estimates(measured: MeasuredScores) -> Scores:
    """The numbers with their intervals, as results hold them."""
    return {
        texture: {
            detector: {
                column: {name: sampled.estimate() for name, sampled in measures.items()}
                for column, measures in by_column.items()
            }
            for detector, by_column in by_detector.items()
        }
        for texture, by_detector in measured.items()
    }


def by_section(
    seen: Mapping[str, Seen],
    truth: Truth,
    weights: Weights,
    sections: Sequence[Sequence[int]],
) -> list[Sampled]:
    """AP (VOC, area, own class), mean over the detectors, of each section of the views."""
    sampled = []
    for views in sections:
        part_truth, rankings = truth.part(views), []
        for observed in seen.values():
            detections, label = observed.column(observed.label), observed.label
            objects, ignored = part_truth.objects(label, label), part_truth.ignored(label, label)
            rankings.append(rank([detections[i] for i in views], objects, 0, ignored=ignored))
        part = weights[:, list(views)]
        sampled.append(mean([Sampled(r.average_precision(part)) for r in rankings]))
    return sampled


def word_for(difference: Sampled, views: int) -> str:
    """``lower`` or ``higher`` where a difference's interval excludes 0, else ``no difference``.

    With fewer than :data:`LEAST_VIEWS` views nothing is claimed: resamples of a few views that are
    all alike do not vary, whatever other views might show.
    """
    if views < LEAST_VIEWS:
        return TOO_FEW
    low, high = difference.interval()
    if high < 0:
        return "lower"
    return "higher" if low > 0 else "no difference"
