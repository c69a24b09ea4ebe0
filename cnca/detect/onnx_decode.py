"""What the numbers of ONNX detectors mean: cells, boxes, probabilities."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from cnca.core.boxes import cxcywh_to_xyxy
from cnca.core.types import Boxes, Candidates
from cnca.detect.classes import COCO, COCO91
from cnca.detect.onnx_options import Options

Rows = Float[Tensor, "batch candidates _"]
Cells = Float[Tensor, "cells 3"]
"""Column, row and stride in pixels."""
Size = tuple[int, int]
"""Height and width of the network's input in pixels."""

LARGEST_PART = 1.5
"""A box in fractions of the picture may stick out of it, but not further than this."""
ROUNDING = 1e-3
"""How far probabilities in half precision may lie outside [0, 1]."""


class Unknown(ValueError):
    """The outputs are of no layout that we know."""


def cells_of_strides(size: Size, strides: Sequence[int]) -> Cells:
    """All cells, level by level; those at the right and bottom may stick out of the picture."""
    cells = []
    for stride in strides:
        rows, columns = (torch.arange(-(-pixels // stride)) for pixels in size)
        y, x = torch.meshgrid(rows, columns, indexing="ij")
        cells.append(torch.stack([x, y, torch.full_like(x, stride)], dim=-1).reshape(-1, 3))
    return torch.cat(cells).float()


def is_undecoded(rows: Rows, cells: Cells) -> bool:
    """Whether centres are nearer to their cells if they are read as offsets than as pixels."""
    origin, stride = cells[:, :2], cells[:, 2:]
    as_offsets = ((rows[..., :2] - 0.5) * stride).abs().median()
    as_pixels = (rows[..., :2] - (origin + 0.5) * stride).abs().median()
    return bool(as_offsets < as_pixels)


def from_offsets(rows: Rows, cells: Cells, centre: float) -> Rows:
    """cxcywh in pixels from offsets and logarithms of sizes in strides (Ge et al. 2021)."""
    origin, stride = cells[:, :2] + centre, cells[:, 2:]
    return torch.cat([(rows[..., :2] + origin) * stride, rows[..., 2:].exp() * stride], dim=-1)


def from_distances(rows: Rows, cells: Cells, centre: float) -> Rows:
    """xyxy in pixels: each side lies the expected distance, in strides, from the cell's centre."""
    origin, stride = (cells[:, :2] + centre) * cells[:, 2:], cells[:, 2:]
    bins = rows.unflatten(-1, (4, -1)).softmax(dim=-1)
    distance = (bins * torch.arange(bins.shape[-1]).to(bins)).sum(dim=-1) * stride
    return torch.cat([origin - distance[..., :2], origin + distance[..., 2:]], dim=-1)


def are_parts(boxes: Rows) -> bool:
    """Whether boxes are measured in widths and heights of the picture: all of them are small."""
    return bool((boxes.abs() <= LARGEST_PART).all())


def corners_in_pixels(
    boxes: Boxes, size: Size, say: Options, *, xyxy: bool, parts: bool = False
) -> Boxes:
    """xyxy in pixels of the input; what the user says about notation and unit wins."""
    if say.boxes == "yxyx":
        boxes = boxes[..., [1, 0, 3, 2]]
    if (say.units or ("picture" if parts else "pixels")) == "picture":
        boxes = boxes * boxes.new_tensor((size[1], size[0]) * 2)
    notation = say.boxes or ("xyxy" if xyxy else "cxcywh")
    return boxes if notation in ("xyxy", "yxyx") else cxcywh_to_xyxy(boxes)


def classes_of(width: int, names: Sequence[str] | None) -> tuple[Sequence[str], bool]:
    """The classes of ``width`` columns of scores, and whether one column more means no object."""
    for known in (names,) if names else (COCO, COCO91):
        if width - len(known) in (0, 1):
            return known, width > len(known)
    raise Unknown(f"has scores of {width} classes, whose names are unknown")


def find_activation(scores: Tensor, surplus: bool = False) -> str:
    """What turns ``scores`` into probabilities: nothing if they look like some already.

    ``surplus`` says that the last column means no object, which only softmax weighs against others.
    """
    if bool(((scores >= -ROUNDING) & (scores <= 1 + ROUNDING)).all()):
        return "none"
    return "softmax" if surplus else "sigmoid"


def activate(scores: Tensor, activation: str) -> Tensor:
    """Probabilities in [0, 1]."""
    if activation == "none":
        return scores.clamp(0, 1)
    return scores.softmax(dim=-1) if activation == "softmax" else scores.sigmoid()


def without_objectness(corners: Rows, scores: Rows) -> Candidates:
    """Candidates of a network without an output for objectness."""
    return Candidates(corners, torch.ones_like(scores[..., 0]), scores)


def of_labels(boxes: Tensor, scores: Tensor, labels: Tensor, classes: int) -> Candidates:
    """Boxes that keep the score of one class; labels of no class, as padding has, score 0."""
    if boxes.ndim == 2:  # an export without a batch
        boxes, scores, labels = boxes[None], scores[None], labels[None]
    columns = labels.round()[..., None] == torch.arange(classes, device=labels.device)
    return without_objectness(boxes, columns * scores.clamp(0, 1)[..., None])
