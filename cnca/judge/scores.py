"""Numbers that say how well a detector finds the vehicle: detection score and AP@0.5.

"AP@0.5" names several numbers.  Three are computed here, all at an overlap (IoU) of at least 0.5:

===========  ======================================================================================
``voc``      Pascal VOC 2010–2012: area under the curve, precision made non-increasing, all points
``voc11``    Pascal VOC 2007: mean of the highest precision at a recall of at least 0, 0.1, …, 1
``coco``     COCO, as pycocotools: the same at 101 recalls, 100 detections of each image
===========  ======================================================================================

They differ in how detections are matched, too.  VOC gives each detection its nearest object, and
where a more confident one has that, it is a false alarm; COCO gives it the nearest object that is
still free.  Detections of equal confidence enter VOC's curve together, so that their order is
without effect; in COCO's they follow the order of the images, as pycocotools has it.  Boxes are in
continuous pixel coordinates (no "+ 1" as in VOC's development kit).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from cnca.core.boxes import iou_matrix, share_inside
from cnca.core.detections import MATCH, suppress
from cnca.core.types import Boxes, Detections

Kind = Literal["voc", "voc11", "coco"]
MOST_DETECTIONS = 100
"""Of one image, in COCO's average precision."""
MOST_NUMBERS = 2**22
"""At once in memory, of each intermediate result."""
RECALLS = {"voc11": np.arange(11) / 10, "coco": np.linspace(0, 1, 101)}
"""Where the interpolated precision is read; ``linspace`` as pycocotools rounds it."""


def detection_score(
    detections: Detections, truth: Float[Tensor, " 4"], label: int, *, iou_threshold: float = MATCH
) -> float:
    """The highest confidence in [0, 1] with which the vehicle at ``truth`` is found, 0 if none.

    Found means: reported as class ``label`` with an overlap of at least ``iou_threshold``.
    """
    of_class = detections.of(label)
    hit = iou_matrix(of_class.boxes, truth[None])[:, 0] >= iou_threshold
    return float(of_class.scores[hit].max()) if bool(hit.any()) else 0.0


def best_scores(detections: Sequence[Detections], boxes: Boxes) -> Float[Tensor, " views"]:
    """The :func:`detection_score` of class 0 in each view, whose vehicle is at its box."""
    scores = [detection_score(image, box, 0) for image, box in zip(detections, boxes, strict=True)]
    return torch.tensor(scores, dtype=torch.float64)


def as_one_class(detections: Detections, labels: Sequence[int]) -> Detections:
    """The detections of any of these classes as class 0, suppressed across the classes.

    A box reported as car and again as truck is one vehicle: the most confident of boxes that
    overlap stays, as within a class (:func:`cnca.core.detections.suppress`).
    """
    wanted = torch.isin(detections.labels, torch.tensor(list(labels), dtype=torch.long))
    boxes, scores = detections.boxes[wanted], detections.scores[wanted]
    if len(labels) == 1:  # its detector has done so already
        return Detections(boxes, scores, torch.zeros_like(detections.labels[wanted]))
    return suppress(boxes, scores[:, None], score_threshold=0.0)


@dataclass(frozen=True)
class Ranking:
    """The detections of one class over many images, most confident first."""

    kind: Kind
    hits: Bool[Tensor, " found"]
    """Whether each finds an object that none before it has found."""
    scores: Float[Tensor, " found"]
    """Confidence of each."""
    images: Int[Tensor, " found"]
    """Index of the image that each belongs to."""
    points: Int[Tensor, " points"]
    """Places in the ranking at which the precision–recall curve has a point."""
    objects: Float[Tensor, " images"]
    """How many objects each image holds."""

    def average_precision(
        self, weights: Float[Tensor, "samples images"]
    ) -> Float[Tensor, " samples"]:
        """Average precision in [0, 1] where image i counts ``weights[:, i]`` ≥ 0 times.

        NaN where no object is counted: the value is undefined.
        """
        rows = max(MOST_NUMBERS // max(len(self.images), 1), 1)
        return torch.cat([self._average_precision(part) for part in weights.split(rows)])

    def _average_precision(
        self, weights: Float[Tensor, "samples images"]
    ) -> Float[Tensor, " samples"]:
        counted = weights[:, self.images]
        hits = (counted * self.hits).cumsum(dim=1)[:, self.points]
        reported = counted.cumsum(dim=1)[:, self.points]
        recall = hits / (weights @ self.objects)[:, None]
        # Nothing reported, nothing hit: 0 / tiny.
        precision = hits / reported.clamp(min=torch.finfo(reported.dtype).tiny)
        # A point of precision 0 at the end, for recalls that are not reached.
        envelope = torch.nn.functional.pad(precision, (0, 1)).flip(1).cummax(1).values.flip(1)
        if self.kind == "voc":
            steps = torch.diff(recall, dim=1, prepend=torch.zeros_like(recall[:, :1]))
            area = (steps * envelope[:, :-1]).sum(dim=1)
            return torch.where(weights @ self.objects > 0, area, torch.nan)
        wanted = torch.from_numpy(RECALLS[self.kind]).expand(len(weights), -1).contiguous()
        read = envelope.gather(1, torch.searchsorted(recall.contiguous(), wanted))
        return torch.where(weights @ self.objects > 0, read.mean(dim=1), torch.nan)


def rank(
    detections: Sequence[Detections],
    truths: Sequence[Boxes],
    label: int,
    *,
    kind: Kind = "voc",
    iou_threshold: float = MATCH,
    ignored: Sequence[Boxes] | None = None,
) -> Ranking:
    """Match the detections of class ``label`` with the objects and rank them by confidence.

    Args:
        truths: one tensor (objects, 4) for each image, xyxy; images without objects count through
            their false alarms.
        ignored: likewise regions in which a detection is neither hit nor false alarm.  It lies in
            one with at least half of its own area (which it does wherever their IoU is one half),
            as COCO has it for crowds.  Another detection of an object that a more confident one has
            found is left out there by COCO, and stays a false alarm for VOC.

    Raises ValueError where the lengths differ.
    """
    scores, hits, images = [torch.zeros(0)], [torch.zeros(0, dtype=torch.bool)], []
    regions = ignored if ignored is not None else [boxes[:0] for boxes in truths]
    for reported, boxes, left_out in zip(detections, truths, regions, strict=True):
        of_class = reported.of(label)
        order = torch.argsort(of_class.scores, descending=True, stable=True)
        if kind == "coco":
            order = order[:MOST_DETECTIONS]
        overlap = iou_matrix(of_class.boxes[order], boxes.to(of_class.boxes))
        match = _free_matches if kind == "coco" else _nearest_matches
        hit = match(overlap.cpu().numpy(), iou_threshold)
        inside = share_inside(of_class.boxes[order], left_out.to(of_class.boxes)).cpu() >= MATCH
        kept = hit | ~inside
        if kind != "coco":
            kept |= (overlap >= iou_threshold).any(dim=1).cpu()
        scores.append(of_class.scores[order].cpu()[kept])
        hits.append(hit[kept])
        images.append(int(kept.sum()))
    joined = torch.cat(scores)
    order = torch.argsort(joined, descending=True, stable=True)
    ranked = joined[order]
    last_of_score = torch.ones(len(ranked), dtype=torch.bool)
    if kind != "coco" and len(ranked):
        last_of_score[:-1] = ranked[1:] != ranked[:-1]
    return Ranking(
        kind=kind,
        hits=torch.cat(hits)[order],
        scores=ranked,
        images=torch.repeat_interleave(torch.tensor(images, dtype=torch.long))[order],
        points=torch.nonzero(last_of_score)[:, 0],
        objects=torch.tensor([len(boxes) for boxes in truths], dtype=torch.float64),
    )


def average_precision(
    detections: Sequence[Detections],
    truths: Sequence[Boxes],
    label: int,
    *,
    kind: Kind = "voc",
    iou_threshold: float = MATCH,
    ignored: Sequence[Boxes] | None = None,
) -> float:
    """Average precision in [0, 1] of one class over many images; arguments as in :func:`rank`.

    Raises:
        ValueError: the lengths differ, or no image holds an object (the value is undefined).
    """
    if not any(len(boxes) for boxes in truths):
        raise ValueError("average precision is undefined: no image holds an object")
    ranking = rank(
        detections, truths, label, kind=kind, iou_threshold=iou_threshold, ignored=ignored
    )
    once = torch.ones(1, len(truths), dtype=torch.float64)
    return float(ranking.average_precision(once))


def _nearest_matches(
    overlap: Float[np.ndarray, "found objects"], least: float
) -> Bool[Tensor, " found"]:
    """VOC: each detection, most confident first, may find the object nearest to it."""
    hits = torch.zeros(len(overlap), dtype=torch.bool)
    taken: set[int] = set()
    for index, row in enumerate(overlap if overlap.shape[1] else ()):
        nearest = int(row.argmax())
        if row[nearest] >= least and nearest not in taken:
            hits[index] = True
            taken.add(nearest)
    return hits


def _free_matches(
    overlap: Float[np.ndarray, "found objects"], least: float
) -> Bool[Tensor, " found"]:
    """COCO: each detection, most confident first, may find the nearest object not yet found."""
    hits, free = torch.zeros(len(overlap), dtype=torch.bool), list(range(overlap.shape[1]))
    for index, row in enumerate(overlap):
        if not free:
            break
        nearest = max(free, key=lambda k: (row[k], k))  # of equals the last, as pycocotools
        if row[nearest] >= least:
            hits[index] = True
            free.remove(nearest)
    return hits
