"""What all detectors share: from candidates to detections."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import torch

from cnca.core.boxes import clip
from cnca.core.detections import ALARM, SUPPRESSION, suppress
from cnca.core.errors import NonFiniteError
from cnca.core.types import Candidates, Detections, SrgbImages


class CandidateDetector(ABC):
    """A detector (``cnca.scene.protocols.Detector``) that is defined by its candidates alone."""

    name: str
    class_names: Sequence[str]
    differentiable: bool
    why_black: str = ""
    """Why a detector that might have a gradient has none."""
    note: str = ""
    """What was assumed when it was loaded, for the user to know."""

    @abstractmethod
    def candidates(self, images: SrgbImages) -> Candidates:
        """Return all boxes before non-maximum suppression, in pixels of ``images``."""

    @torch.no_grad()
    def detect(
        self,
        images: SrgbImages,
        *,
        score_threshold: float = ALARM,
        iou_threshold: float = SUPPRESSION,
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
