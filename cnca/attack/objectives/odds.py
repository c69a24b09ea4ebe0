"""The odds of all boxes on the vehicle, against those of the confidence at which AP counts one."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from cnca.attack.detection_scores import check_full_overlap, confidences, overlaps
from cnca.core.types import Boxes, Candidates

MOST = 1.0 - 1e-6


@dataclass(frozen=True)
class Loss:
    """log(1 + Σ_b w_b · odds(c_b) / odds(cut)), odds(c) = c / (1 − c), c_b = D_c · D_o of box b.

    The sum takes every box at once, where a maximum hides the next best one until its turn comes.
    Far above the cut this is the logit of the surest box, whose slope does not fade; far below it
    the pressure ends: no view is pushed that AP no longer counts.

    w_b, the overlap with the vehicle up to ``full_overlap``, has no gradient: a box is to become
    less sure, not to slip off the vehicle, where it would be a false alarm.
    """

    full_overlap: float = 0.5
    """IoU from which a box counts in full, in (0, 1]; 0.5 is where AP@0.5 counts it."""
    cut: float = 0.01
    """Confidence in (0, 1) from which a box is counted."""

    def __post_init__(self) -> None:
        check_full_overlap(self.full_overlap)

    def __call__(
        self, candidates: Candidates, vehicle_boxes: Boxes, label: int
    ) -> Float[Tensor, " batch"]:
        """The loss of each image, ≥ 0; 0 where no box is on the vehicle."""
        sure = confidences(candidates, label).clamp(max=MOST)
        weights = overlaps(candidates, vehicle_boxes, self.full_overlap).detach()
        odds = (weights * sure / (1.0 - sure)).sum(dim=1)
        return torch.log1p(odds * (1.0 - self.cut) / self.cut)
