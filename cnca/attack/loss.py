"""The adversarial loss (paper, equation 11)."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from cnca.core.boxes import iou
from cnca.core.types import Candidates


def detection_loss(
    candidates: Candidates,
    target_boxes: Float[Tensor, "batch 4"],
    class_index: int,
    *,
    full_overlap: float = 1.0,
) -> tuple[Float[Tensor, ""], Float[Tensor, " batch"]]:
    """Return the mean of L_adv over the images, and max D_s of each image in [0, 1].

    D_s = IoU(D_b, gt) · D_c · D_o and L_adv = −log(1 − max D_s).  ``target_boxes`` (gt) are
    the vehicles' boxes, xyxy in pixels; ``class_index`` picks D_c.  ``full_overlap`` in (0, 1] is
    the IoU from which a box counts in full: 1 is the paper's; 0.5 asks what AP@0.5 asks, where
    shifting the box gains nothing and only its confidence counts.

    At the edges: D_s enters the logarithm times 1 − ε (ε the type's machine epsilon), so that
    D_s = 1 costs −log ε (15.9 in float32) and still has the slope 1/ε; an image without
    candidates, or whose candidates all miss the vehicle, scores 0 and costs 0.
    """
    scores = _best_scores(candidates, target_boxes, class_index, full_overlap)
    below_one = 1.0 - torch.finfo(scores.dtype).eps
    return -torch.log1p(-scores * below_one).mean(), scores


def _best_scores(
    candidates: Candidates,
    target_boxes: Float[Tensor, "batch 4"],
    class_index: int,
    full_overlap: float,
) -> Float[Tensor, " batch"]:
    """max D_s of each image; 0, yet part of the autograd graph, without candidates."""
    overlap = (iou(candidates.boxes, target_boxes[:, None, :]) / full_overlap).clamp(max=1.0)
    scores = overlap * candidates.class_scores[..., class_index] * candidates.objectness
    if scores.shape[1] == 0:
        return scores.sum(dim=1)
    return scores.amax(dim=1)
