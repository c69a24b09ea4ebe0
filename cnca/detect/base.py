"""What all detectors share: from candidates to detections."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import cv2
import torch
from jaxtyping import Float
from torch import Tensor

from cnca.core.boxes import clip
from cnca.core.errors import NonFiniteError
from cnca.core.types import Boxes, Candidates, Detections, SrgbImages


class CandidateDetector(ABC):
    """A detector (``cnca.scene.protocols.Detector``) that is told apart by its candidates alone."""

    name: str
    class_names: Sequence[str]
    differentiable: bool

    @abstractmethod
    def candidates(self, images: SrgbImages) -> Candidates:
        """Return all boxes before non-maximum suppression, in pixels of ``images``."""

    @torch.no_grad()
    def detect(
        self, images: SrgbImages, *, score_threshold: float = 0.25, iou_threshold: float = 0.45
    ) -> list[Detections]:
        """Return the boxes of each image after thresholds and suppression within each class.

        A candidate is reported for every class whose D_c · D_o reaches ``score_threshold``.

        Raises:
            NonFiniteError: an image, or what the detector computed from it, is NaN or infinite.
        """
        for index, image in enumerate(images):
            if not bool(image.isfinite().all()):
                raise NonFiniteError(f"{self.name}: image {index} holds a non-finite value")
        found = self.candidates(images)
        scores = found.objectness[..., None] * found.class_scores
        for index, (image_boxes, image_scores) in enumerate(zip(found.boxes, scores, strict=True)):
            if not bool(image_boxes.isfinite().all() and image_scores.isfinite().all()):
                raise NonFiniteError(f"{self.name}: image {index} gives a non-finite candidate")
        boxes = clip(found.boxes, *images.shape[2:])
        return [
            suppress(*pair, score_threshold=score_threshold, iou_threshold=iou_threshold)
            for pair in zip(boxes, scores, strict=True)
        ]


def suppress(
    boxes: Boxes,
    scores: Float[Tensor, "candidates classes"],
    *,
    score_threshold: float,
    iou_threshold: float,
) -> Detections:
    """Greedy non-maximum suppression within each class of one image, best first."""
    index, labels = torch.nonzero(scores >= score_threshold, as_tuple=True)
    boxes, scores = boxes[index], scores[index, labels]
    if len(index):
        # float64, or OpenCV takes the variant for boxes of whole pixels.  Arrays will do, though
        # the stubs ask for lists.
        corners = boxes.double().cpu()
        left_top_size = torch.cat([corners[:, :2], corners[:, 2:] - corners[:, :2]], dim=1)
        kept = cv2.dnn.NMSBoxesBatched(
            left_top_size.numpy(),  # type: ignore[arg-type]
            scores.float().cpu().numpy(),  # type: ignore[arg-type]
            labels.int().cpu().numpy(),  # type: ignore[arg-type]
            score_threshold=0.0,  # applied above
            nms_threshold=iou_threshold,
        )
        keep = torch.as_tensor(kept, dtype=torch.long, device=boxes.device).flatten()
        keep = keep[torch.argsort(scores[keep], descending=True, stable=True)]
        boxes, scores, labels = boxes[keep], scores[keep], labels[keep]
    return Detections(boxes, scores, labels)
