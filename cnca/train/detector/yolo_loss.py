"""The training loss of YOLOv3's heads (Redmon & Farhadi 2018, section 2), with CIoU for boxes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits as cross_entropy

from cnca.core.boxes import SMALLEST_AREA, iou, iou_matrix, xyxy_to_cxcywh
from cnca.core.types import Boxes
from cnca.detect.yolo import YoloHead
from cnca.train.detector.anchors import shape_iou

BOX_WEIGHT = 3.0
SHAPE_THRESHOLD = 0.5
"""An anchor answers for an object from this overlap of their shapes on; so does the best one."""
IGNORE_THRESHOLD = 0.6
"""A box that overlaps an object by this much or more, and does not answer for it, is ignored."""


@dataclass(frozen=True)
class Targets:
    """The objects in a batch of network inputs, one row for each."""

    boxes: Float[Tensor, "objects 4"]
    """xyxy in pixels of the network's input."""
    labels: Int[Tensor, " objects"]
    """Class."""
    images: Int[Tensor, " objects"]
    """Position in the batch."""


def ciou(first: Boxes, second: Boxes) -> Float[Tensor, "*batch"]:
    """Complete IoU in (−1, 1] (Zheng et al. 2020): overlap less distance and difference of shape.

    Boxes without extent count as if their sides were ``SMALLEST_AREA`` long.
    """
    overlap = iou(first, second)
    (centre_1, size_1), (centre_2, size_2) = (
        xyxy_to_cxcywh(boxes).split(2, dim=-1) for boxes in (first, second)
    )
    low = torch.minimum(first[..., :2], second[..., :2])
    high = torch.maximum(first[..., 2:], second[..., 2:])
    diagonal = (high - low).square().sum(-1).clamp(min=SMALLEST_AREA)
    distance = (centre_1 - centre_2).square().sum(-1) / diagonal
    angles = [torch.atan2(size[..., 0], size[..., 1] + SMALLEST_AREA) for size in (size_1, size_2)]
    shape = 4 / math.pi**2 * (angles[0] - angles[1]).square()
    weight = (shape / (1 - overlap + shape + SMALLEST_AREA)).detach()
    return overlap - distance - weight * shape


def yolo_loss(
    heads: list[YoloHead],
    raw: list[Float[Tensor, "batch outputs _ _"]],
    targets: Targets,
    size: tuple[int, int],
) -> dict[str, Float[Tensor, ""]]:
    """Return the losses ``box``, ``objectness`` and ``class``, each summed and divided by batch.

    ``raw`` are the network's outputs in float32, ``size`` its input (height, width).
    """
    anchors = torch.tensor([anchor for head in heads for anchor in head.anchors])
    fits = _fitting_anchors(targets.boxes, anchors.to(targets.boxes))
    losses = []
    first = 0
    for head, values in zip(heads, raw, strict=True):
        fits_head = fits[:, first : first + len(head.anchors)]
        losses.append(_head_loss(head, values, targets, fits_head, size))
        first += len(head.anchors)
    box, objectness, label = (torch.stack(parts).sum() for parts in zip(*losses, strict=True))
    batch = len(raw[0])
    return {"box": box / batch, "objectness": objectness / batch, "class": label / batch}


def _fitting_anchors(boxes: Boxes, anchors: Float[Tensor, "anchors 2"]) -> Tensor:
    """Which anchors of all heads answer for which object, (objects, anchors)."""
    overlap = shape_iou(boxes[:, 2:] - boxes[:, :2], anchors)
    best = overlap == overlap.amax(dim=1, keepdim=True)
    return best | (overlap >= SHAPE_THRESHOLD)


def _head_loss(
    head: YoloHead, raw: Tensor, targets: Targets, fits: Tensor, size: tuple[int, int]
) -> tuple[Tensor, Tensor, Tensor]:
    """Summed losses for box, objectness and class of one head; ``fits`` is (objects, anchors)."""
    split = head.split(raw)
    rows, columns = split.shape[2:4]
    stride = (size[1] / columns, size[0] / rows)
    boxes = head.boxes(split, stride)

    objects, anchor = torch.nonzero(fits, as_tuple=True)
    centre = xyxy_to_cxcywh(targets.boxes[objects])[:, :2] / targets.boxes.new_tensor(stride)
    column = centre[:, 0].long().clamp(0, columns - 1)
    row = centre[:, 1].long().clamp(0, rows - 1)
    where = (targets.images[objects], anchor, row, column)

    answer = split[where]
    box_loss = BOX_WEIGHT * (1 - ciou(boxes[where], targets.boxes[objects])).sum()
    classes = torch.nn.functional.one_hot(targets.labels[objects], head.classes)
    class_loss = cross_entropy(answer[:, 5:], classes.to(answer), reduction="sum")

    expected = torch.zeros_like(split[..., 4])
    expected[where] = 1.0
    counts = ~_near_an_object(boxes.detach(), targets)
    counts[where] = True
    objectness = cross_entropy(split[..., 4], expected, reduction="none")
    return box_loss, (objectness * counts).sum(), class_loss


def _near_an_object(
    boxes: Float[Tensor, "batch anchors rows columns 4"], targets: Targets
) -> Tensor:
    """Which boxes overlap an object of their image by at least the ignore threshold."""
    near = torch.zeros(boxes.shape[:-1], dtype=torch.bool, device=boxes.device)
    for image in targets.images.unique().tolist():
        overlap = iou_matrix(boxes[image].flatten(0, 2), targets.boxes[targets.images == image])
        near[image] = (overlap.amax(dim=1) >= IGNORE_THRESHOLD).view(near[image].shape)
    return near
