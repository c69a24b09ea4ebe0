"""The paper's loss, equation 11: −log(1 − max D_s)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from cnca.attack.detection_scores import best_scores, check_full_overlap
from cnca.core.types import Boxes, Candidates


@dataclass(frozen=True)
class Loss:
    """L_adv = −log(1 − max D_s), D_s = IoU(D_b, gt) · D_c · D_o.

    Its slope in the logit of D_s is D_s itself: what is nearly hidden is left alone.

    At the edges: D_s enters the logarithm times 1 − ε (ε the type's machine epsilon), so that
    D_s = 1 costs −log ε (15.9 in float32) and still has the slope 1/ε; an image without
    candidates, or whose candidates all miss the vehicle, costs 0.
    """

    full_overlap: float = 1.0
    """IoU from which a box counts in full, in (0, 1]; 1 is the paper's."""

    def __post_init__(self) -> None:
        check_full_overlap(self.full_overlap)

    def __call__(
        self, candidates: Candidates, vehicle_boxes: Boxes, label: int
    ) -> Float[Tensor, " batch"]:
        """L_adv of each image, ≥ 0."""
        scores = best_scores(candidates, vehicle_boxes, label, full_overlap=self.full_overlap)
        return -torch.log1p(-scores * (1.0 - torch.finfo(scores.dtype).eps))
