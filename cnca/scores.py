"""Numbers that say how well a detector finds the vehicle."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from cnca.boxes import iou_matrix
from cnca.types import Boxes, Detections


def detection_score(
    detections: Detections, truth: Float[Tensor, " 4"], label: int, *, iou_threshold: float = 0.5
) -> float:
    """The highest confidence in [0, 1] with which the vehicle at ``truth`` is found, 0 if none.

    Found means: reported as class ``label`` with an overlap of at least ``iou_threshold``.
    """
    of_class = detections.of(label)
    hit = iou_matrix(of_class.boxes, truth[None])[:, 0] >= iou_threshold
    return float(of_class.scores[hit].max()) if bool(hit.any()) else 0.0


def average_precision(
    detections: Sequence[Detections],
    truths: Sequence[Boxes],
    label: int,
    *,
    iou_threshold: float = 0.5,
) -> float:
    """Average precision in [0, 1] of one class over many images (Pascal VOC 2010, all points).

    ``truths`` holds one tensor (objects, 4) for each image, xyxy; images without objects count
    through their false alarms.  Detections of equal confidence enter the precision–recall curve
    together, so that their order is without effect.

    Raises:
        ValueError: the lengths differ, or no image holds an object (the value is undefined).
    """
    objects = sum(len(boxes) for boxes in truths)
    if objects == 0:
        raise ValueError("average precision is undefined: no image holds an object")
    of_class = [found.of(label) for found in detections]
    scores = torch.cat([found.scores for found in of_class])
    hits = torch.cat(
        [
            _matches(found, boxes, iou_threshold)
            for found, boxes in zip(of_class, truths, strict=True)
        ]
    )
    order = torch.argsort(scores, descending=True)
    return _area_under_curve(scores[order], hits[order], objects)


def _matches(found: Detections, truths: Boxes, iou_threshold: float) -> Bool[Tensor, " found"]:
    """Whether each detection finds an object that no more confident one has found before."""
    hits = torch.zeros(len(found.scores), dtype=torch.bool, device=found.scores.device)
    if len(truths) == 0:
        return hits
    overlap, nearest = iou_matrix(found.boxes, truths.to(found.boxes)).max(dim=1)
    taken: set[int] = set()
    for index in torch.argsort(found.scores, descending=True, stable=True).tolist():
        object_index = int(nearest[index])
        if overlap[index] >= iou_threshold and object_index not in taken:
            taken.add(object_index)
            hits[index] = True
    return hits


def _area_under_curve(scores: Float[Tensor, " n"], hits: Bool[Tensor, " n"], objects: int) -> float:
    """Area under precision over recall, precision made non-increasing; ``scores`` descend."""
    if len(scores) == 0:
        return 0.0
    last_of_score = torch.ones_like(hits)
    last_of_score[:-1] = scores[1:] != scores[:-1]
    found = hits.cumsum(0).double()[last_of_score]
    reported = torch.arange(1, len(scores) + 1, device=scores.device)[last_of_score]
    recall = found / objects
    precision = (found / reported).flip(0).cummax(0).values.flip(0)
    steps = recall.diff(prepend=recall.new_zeros(1))
    return float((steps * precision).sum())
