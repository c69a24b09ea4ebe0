"""The thresholds of detection and the one suppression: every room takes them from here."""

from __future__ import annotations

import cv2
import torch
from jaxtyping import Float
from torch import Tensor

from cnca.core.types import Boxes, Detections

ALARM = 0.25
"""Confidence from which something counts as found: in pictures, and in success rates."""
LEAST_SCORE = 0.01
"""Detections below this confidence count as none; low, since scores are averaged, not counted."""
FAINTEST_SCORE = 0.001
"""Least confidence of kept detections: what COCO's and MMDetection's testers count."""
MATCH = 0.5
"""Intersection over union from which a detection finds an object: the 0.5 of AP@0.5."""
SUPPRESSION = 0.45
"""Intersection over union above which the less confident of two detections is dropped."""


def suppress(
    boxes: Boxes,
    scores: Float[Tensor, "candidates classes"],
    *,
    score_threshold: float,
    iou_threshold: float = SUPPRESSION,
) -> Detections:
    """Greedy non-maximum suppression within each class of one image, best first.

    A candidate is reported for every class whose score reaches ``score_threshold``.
    """
    index, labels = torch.nonzero(scores >= score_threshold, as_tuple=True)
    boxes, scores = boxes[index], scores[index, labels]
    if len(index):
        # float64, or OpenCV takes the variant for boxes of whole pixels.  Arrays will do, though
        # the stubs ask for lists.
        corners = boxes.double().cpu()
        left_top_size = torch.cat([corners[:, :2], corners[:, 2:] - corners[:, :2]], dim=1)
        kept = cv2.dnn.NMSBoxesBatched(
            left_top_size.numpy(),
            scores.float().cpu().numpy(),
            labels.int().cpu().numpy(),
            score_threshold=0.0,  # applied above
            nms_threshold=iou_threshold,
        )
        keep = torch.as_tensor(kept, dtype=torch.long, device=boxes.device).flatten()
        keep = keep[torch.argsort(scores[keep], descending=True, stable=True)]
        boxes, scores, labels = boxes[keep], scores[keep], labels[keep]
    return Detections(boxes, scores, labels)
