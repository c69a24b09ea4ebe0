"""Layouts of single families, told by the shapes of four-dimensional outputs.

FastestDet (X. Ma 2022) has one level: for each cell objectness, a box and classes.  Its confidence
is D_o^0.6 · D_c^0.4.  YOLO-FastestV2 (X. Ma 2021) has two levels with three anchors each, whose
boxes are those of YOLOv5; classes are shared by the anchors of a cell.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from cnca.core.boxes import cxcywh_to_xyxy
from cnca.core.types import Candidates
from cnca.detect.classes import COCO
from cnca.detect.grid import cell_corners
from cnca.detect.onnx_decode import Size, activate, find_activation

OBJECT_POWER, CLASS_POWER = 0.6, 0.4
LEAST = 1e-12
"""Where a power's slope is still finite."""
V2_ANCHORS = (
    ((12.64, 19.39), (37.88, 51.48), (55.71, 138.31)),
    ((126.91, 78.23), (131.57, 214.55), (279.92, 258.87)),
)
"""Widths and heights in pixels of an input of 352, finest level first; trained on COCO."""
V2_SIZE = 352
V2_ANCHOR_COUNT = 3


def channels_of(shape: Sequence[int], names: Sequence[str] | None) -> tuple[str, int] | None:
    """The family that an output of this shape may be of, and the axis of its channels."""
    classes = len(names or COCO)
    widths = {"fastestdet": 5 + classes, "yolo-fastest-v2": 5 * V2_ANCHOR_COUNT + classes}
    for kind, width in widths.items():
        for axis in (1, 3):
            if shape[axis] == width and shape[4 - axis] > 1:
                return kind, axis
    return None


def fastestdet(output: Tensor, size: Size) -> Candidates:
    """Candidates of an output (batch, 5 + classes, rows, columns) in pixels of the input.

    Centres lie tanh of the output off their cell's corner, in cells; sizes are the logistic
    function of the output, in fractions of the input.  Objectness and classes are already
    probabilities.
    """
    rows, columns = output.shape[2:]
    values = output.permute(0, 2, 3, 1)
    extent = output.new_tensor((size[1], size[0]))
    cells = output.new_tensor((columns, rows))
    centres = (values[..., 1:3].tanh() + cell_corners(rows, columns, output)) / cells * extent
    sizes = values[..., 3:5].sigmoid() * extent
    boxes = cxcywh_to_xyxy(torch.cat([centres, sizes], dim=-1)).flatten(1, 2)
    sure = values[..., :1].clamp(LEAST, 1) ** OBJECT_POWER
    scores = sure * values[..., 5:].clamp(LEAST, 1) ** CLASS_POWER
    return Candidates(boxes, torch.ones_like(boxes[..., 0]), scores.flatten(1, 2))


def yolo_fastest_v2(outputs: Sequence[Tensor], size: Size) -> Candidates:
    """Candidates of levels (batch, rows, columns, 12 + 3 + classes), in pixels of the input."""
    finest_first = sorted(outputs, key=lambda o: -o.shape[1])
    parts = [_v2_level(o, size, a) for o, a in zip(finest_first, V2_ANCHORS, strict=True)]
    boxes, objectness, scores = (torch.cat(part, dim=1) for part in zip(*parts, strict=True))
    return Candidates(boxes, objectness, scores)


def _v2_level(
    values: Tensor, size: Size, anchors: Sequence[tuple[float, float]]
) -> tuple[Tensor, Tensor, Tensor]:
    rows, columns = values.shape[1:3]
    extent = values.new_tensor((size[1], size[0]))
    stride = extent / values.new_tensor((columns, rows))
    end = 4 * len(anchors)
    box = values[..., :end].unflatten(-1, (len(anchors), 4))
    box = activate(box, find_activation(box))
    sure = values[..., end : end + len(anchors)]
    sure = activate(sure, find_activation(sure))
    classes = values[..., end + len(anchors) :]
    classes = activate(classes, "none" if find_activation(classes) == "none" else "softmax")
    cells = cell_corners(rows, columns, values)[:, :, None]
    centres = (2 * box[..., :2] - 0.5 + cells) * stride
    sizes = (2 * box[..., 2:]).square() * values.new_tensor(anchors) * extent / V2_SIZE
    boxes = cxcywh_to_xyxy(torch.cat([centres, sizes], dim=-1)).flatten(1, 3)
    scores = classes[:, :, :, None].expand(*sure.shape, -1)
    return boxes, sure.flatten(1), scores.flatten(1, 3)
