"""The logit of the best detection score: it goes on pushing where equation 11 has let go."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from cnca.attack.detection_scores import best_scores, check_full_overlap
from cnca.core.types import Boxes, Candidates

LEAST, MOST = 1e-4, 1.0 - 1e-6
"""Scores beyond these count as these: far below every threshold, and as sure as can be."""


@dataclass(frozen=True)
class Loss:
    """log(s / (1 − s)) of s = max D_s, clamped to [1e-4, 1 − 1e-6].

    Average precision counts every box from a confidence of 0.01 on.  The slope of this loss is the
    same for a score of 0.9 as for one of 0.01; at the clamp it is 0.
    """

    full_overlap: float = 0.5
    """IoU from which a box counts in full, in (0, 1]; 0.5 is where AP@0.5 counts it."""

    def __post_init__(self) -> None:
        check_full_overlap(self.full_overlap)

    def __call__(
        self, candidates: Candidates, vehicle_boxes: Boxes, label: int
    ) -> Float[Tensor, " batch"]:
        """The logit of each image, in [−9.21, 13.8]."""
        scores = best_scores(candidates, vehicle_boxes, label, full_overlap=self.full_overlap)
        return torch.logit(scores.clamp(LEAST, MOST))
