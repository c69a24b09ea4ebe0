"""The detection scores D_s of the paper's equation 11, from which every objective is made."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor

from cnca.core.boxes import iou
from cnca.core.errors import RunError
from cnca.core.types import Boxes, Candidates


def check_full_overlap(full_overlap: float) -> None:
    """Raise RunError unless the IoU from which a box counts in full is a valid one."""
    if not 0 < full_overlap <= 1:
        raise RunError(f"full_overlap is {full_overlap}: an IoU lies in (0, 1]")


def overlaps(
    candidates: Candidates, vehicle_boxes: Boxes, full_overlap: float
) -> Float[Tensor, "batch candidates"]:
    """How far each box is on the vehicle: IoU(D_b, gt) / ``full_overlap``, at most 1.

    With ``full_overlap`` 1 this is the paper's IoU; with 0.5 a box counts in full from where
    AP@0.5 takes it for the vehicle, so that shifting it gains nothing.
    """
    return (iou(candidates.boxes, vehicle_boxes[:, None, :]) / full_overlap).clamp(max=1.0)


def confidences(candidates: Candidates, label: int) -> Float[Tensor, "batch candidates"]:
    """D_c · D_o in [0, 1]: how sure the detector is of a vehicle in each box."""
    return candidates.class_scores[..., label] * candidates.objectness


def best_scores(
    candidates: Candidates, vehicle_boxes: Boxes, label: int, *, full_overlap: float = 1.0
) -> Float[Tensor, " batch"]:
    """max D_s of each image, D_s = IoU(D_b, gt) · D_c · D_o.

    An image without candidates scores 0, yet stays part of the autograd graph.
    """
    scores = overlaps(candidates, vehicle_boxes, full_overlap) * confidences(candidates, label)
    if scores.shape[1] == 0:
        return scores.sum(dim=1)
    return scores.amax(dim=1)
