"""Pixel boxes: the one place where their overlap and their two notations are computed."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from cnca.core.types import Boxes

SMALLEST_AREA = 1e-9
"""Square pixels; an area below counts as this one, so that overlaps of empty boxes are 0."""


def xyxy_to_cxcywh(boxes: Boxes) -> Boxes:
    """(left, top, right, bottom) → (center x, center y, width, height)."""
    low, high = boxes[..., :2], boxes[..., 2:]
    return torch.cat([(low + high) / 2, high - low], dim=-1)


def cxcywh_to_xyxy(boxes: Boxes) -> Boxes:
    """(center x, center y, width, height) → (left, top, right, bottom)."""
    centre, half = boxes[..., :2], boxes[..., 2:] / 2
    return torch.cat([centre - half, centre + half], dim=-1)


def clip(boxes: Boxes, height: float, width: float) -> Boxes:
    """Cut boxes at the borders of a picture; a box outside becomes one without area."""
    limit = boxes.new_tensor([width, height, width, height])
    return torch.minimum(boxes.clamp(min=0.0), limit)


def area(boxes: Boxes) -> Float[Tensor, "*batch"]:
    """Width times height in square pixels; 0 for boxes whose sides are swapped."""
    return (boxes[..., 2:] - boxes[..., :2]).clamp(min=0.0).prod(dim=-1)


def iou(
    first: Float[Tensor, "*#batch 4"], second: Float[Tensor, "*#batch 4"]
) -> Float[Tensor, "*#batch"]:
    """Intersection over union in [0, 1] of boxes that broadcast against each other.

    Differentiable; boxes without area overlap nothing (0, with a finite gradient).
    """
    low = torch.maximum(first[..., :2], second[..., :2])
    high = torch.minimum(first[..., 2:], second[..., 2:])
    intersection = (high - low).clamp(min=0.0).prod(dim=-1)
    union = area(first) + area(second) - intersection
    # Rounding may leave the union an ulp below the intersection: hence the upper bound.
    return (intersection / union.clamp(min=SMALLEST_AREA)).clamp(max=1.0)


def iou_matrix(
    first: Float[Tensor, "*batch n 4"], second: Float[Tensor, "*batch m 4"]
) -> Float[Tensor, "*batch n m"]:
    """The overlap of every box of ``first`` with every box of ``second``."""
    return iou(first[..., :, None, :], second[..., None, :, :])


def share_inside(boxes: Boxes, regions: Boxes) -> Float[Tensor, " boxes"]:
    """The largest share of each box's own area that lies in one of the regions, in [0, 1]."""
    if not len(regions):
        return boxes.new_zeros(len(boxes))
    low = torch.maximum(boxes[:, None, :2], regions[None, :, :2])
    high = torch.minimum(boxes[:, None, 2:], regions[None, :, 2:])
    common = (high - low).clamp(min=0.0).prod(dim=-1).amax(dim=1)
    return common / area(boxes).clamp(min=SMALLEST_AREA)
