"""The measures of other papers and benchmarks, over the same views and resamples as ours.

All ask for an overlap (IoU) of at least one half; see :mod:`cnca.judge.protocol_names`.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from cnca.core.types import Detections
from cnca.judge.bootstrap import Sampled
from cnca.judge.scores import Ranking, best_scores, rank
from cnca.judge.truth import Truth

Weights = Float[Tensor, "samples views"]
Samples = Float[Tensor, " samples"]

CUTS = {"AP_05": 0.05, "AP_25": 0.25, "AP_50": 0.5}
SURE = 0.5
"""Confidence from which R-PGA and FCA call a vehicle detected."""
ALARMS = 0.1
"""False alarms a picture at which the miss rate is read."""
REFERENCES = torch.logspace(-2, 0, 9, dtype=torch.float64)
"""False alarms a picture at which Caltech's miss rates are read (Dollár et al. 2012, section 4)."""
LEAST_MISSES = 1e-10
"""Where nothing is missed, whose logarithm would not be finite."""


def measure_by_protocols(
    found: Sequence[Detections],
    clean: Sequence[Detections],
    truth: Truth,
    weights: Weights,
    column: str,
    label: str,
) -> dict[str, Sampled]:
    """Every measure of :data:`cnca.judge.protocol_names.MEASURES` for one texture and detector.

    Args:
        found: detections of the vehicle's class, as class 0, from a confidence of 0.001 on.
        clean: the same for the normal paint in the same views.
        column: of ``truth``: which vehicles are to be found besides.
    """
    truths, ignored = truth.objects(column, label), truth.ignored(column, label)
    alone = [box[None] for box in truth.boxes]
    scores = best_scores(found, truth.boxes)
    detected = _share(weights, scores >= SURE)
    coco, coco_clean = (
        rank(d, truths, 0, kind="coco", ignored=ignored).average_precision(weights)
        for d in (found, clean)
    )
    # R-PGA: the vehicle alone is to be found, and whatever else is called one is a false alarm.
    rpga = rank(found, alone, 0, kind="voc11").average_precision(weights)
    curve, clean_curve = (rank(d, truths, 0, ignored=ignored) for d in (found, clean))
    values = {
        "AP_001": coco,
        **{
            name: rank([d.above(cut) for d in found], truths, 0, ignored=ignored).average_precision(
                weights
            )
            for name, cut in CUTS.items()
        },
        "AP_rpga": rpga,
        "ASR_rpga": 1 - detected,
        "found_50": detected,
        "ASR_padetbench": 1 - coco / coco_clean,
        "miss_01": _misses_at_alarms(clean_curve, scores, weights),
        "LAMR": _log_average_miss_rate(curve, weights),
    }
    return {name: Sampled(value) for name, value in values.items()}


def _share(weights: Weights, holds: Tensor) -> Samples:
    return weights @ holds.double() / weights.sum(dim=1)


def _misses_at_alarms(clean: Ranking, scores: Float[Tensor, " views"], weights: Weights) -> Samples:
    """Share of views missed at the lowest threshold with few enough false alarms on ``clean``."""
    alarms = ~clean.hits
    if not alarms.any():
        return _share(weights, scores <= 0)
    rates = weights[:, clean.images[alarms]].cumsum(dim=1) / weights.sum(dim=1)[:, None]
    too_many = rates > ALARMS
    first = too_many.double().argmax(dim=1)
    # Detections must be surer than the first false alarm that is one too many.
    thresholds = torch.where(too_many.any(dim=1), clean.scores[alarms].double()[first], 0.0)
    missed = (scores[None] <= thresholds[:, None]).double()
    return (weights * missed).sum(dim=1) / weights.sum(dim=1)


def _log_average_miss_rate(curve: Ranking, weights: Weights) -> Samples:
    """The geometric mean of the miss rates at :data:`REFERENCES` false alarms a picture.

    Before its first detection a curve misses everything.
    """
    counted = weights[:, curve.images]
    start = torch.zeros(len(weights), 1, dtype=counted.dtype)
    objects = (weights @ curve.objects)[:, None]
    hits, alarms = (
        torch.cat([start, (counted * which).cumsum(dim=1)], dim=1)
        for which in (curve.hits, ~curve.hits)
    )
    rates = (alarms / weights.sum(dim=1)[:, None]).contiguous()
    wanted = REFERENCES.expand(len(weights), -1).contiguous()
    last = torch.searchsorted(rates, wanted, right=True) - 1
    misses = (1 - hits / objects).gather(1, last)
    return misses.clamp(min=LEAST_MISSES).log().mean(dim=1).exp()
