"""How well a detector does on a labelled data set, group by group."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby

import numpy as np
import torch

from cnca.core.detections import ALARM, LEAST_SCORE
from cnca.core.types import Detections, SrgbImages
from cnca.judge.scores import average_precision, detection_score
from cnca.scene.protocols import Detector
from cnca.train.detector.dataset import TEST, LabelledPictures


def measure(
    detector: Detector, data: LabelledPictures, *, label: int = 0, batch: int = 32
) -> dict[str, dict[str, float]]:
    """Return, for each group of the test half and for ``all``, what was found of class ``label``.

    ``pictures`` counts them.  With objects: ``ap50`` (average precision at IoU 0.5) and ``found``
    (fraction of the objects found at confidence 0.25 or more).  ``false_alarms`` is the fraction
    of pictures without objects in which something is reported at 0.25 or more.
    """
    indices = data.of_split(TEST)
    detections: list[Detections] = []
    for _, alike in groupby(indices, key=lambda index: data.pictures[index].shape):
        for chosen in _batched(list(alike), batch):
            pictures = np.stack([data.pictures[index] for index in chosen])
            images = torch.from_numpy(pictures).permute(0, 3, 1, 2).float() / 255
            detections += detector.detect(SrgbImages(images), score_threshold=LEAST_SCORE)
    truths = [_boxes_of(data.boxes[index], label) for index in indices]
    groups = [data.groups[index] for index in indices]
    report = {"all": _summary(detections, truths, label)}
    for group in sorted(set(groups)):
        pairs = zip(detections, truths, groups, strict=True)
        members = [(detected, truth) for detected, truth, name in pairs if name == group]
        report[group] = _summary([f for f, _ in members], [t for _, t in members], label)
    return report


def _batched(items: list[int], count: int) -> Iterator[list[int]]:
    """Runs of at most ``count`` items."""
    for start in range(0, len(items), count):
        yield items[start : start + count]


def _boxes_of(labels: np.ndarray, label: int) -> torch.Tensor:
    return torch.from_numpy(labels[labels[:, 4] == label, :4]).float()


def _summary(
    detections: list[Detections], truths: list[torch.Tensor], label: int
) -> dict[str, float]:
    summary: dict[str, float] = {"pictures": len(truths)}
    scores = [
        detection_score(detected, box, label)
        for detected, boxes in zip(detections, truths, strict=True)
        for box in boxes
    ]
    if scores:
        summary["ap50"] = round(average_precision(detections, truths, label), 4)
        summary["found"] = round(float(np.mean(np.array(scores) >= ALARM)), 4)
    empty = [
        bool((detected.of(label).scores >= ALARM).any())
        for detected, boxes in zip(detections, truths, strict=True)
        if len(boxes) == 0
    ]
    if empty:
        summary["false_alarms"] = round(float(np.mean(empty)), 4)
    return summary
