"""An anchor-free head: one box per cell, as YOLOX has it (Ge et al. 2021), without objectness."""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch
from jaxtyping import Float
from torch import Tensor, nn

from cnca.core.boxes import cxcywh_to_xyxy
from cnca.core.types import Candidates
from cnca.detect.cfg import Section
from cnca.detect.grid import cell_corners
from cnca.detect.yolo import LARGEST_EXPONENT

USUAL_SIZE = 4.0
"""Size of an object in cells: where training starts."""
Raw = Float[Tensor, "batch outputs _ _"]


class AnchorFreeHead(nn.Module):
    """Marks a place where boxes are read off; passes its input on unchanged.

    Outputs of each cell: the centre's offset from the cell's corner and the logarithm of the size,
    both in strides; then the logits of all classes.
    """

    def __init__(self, classes: int) -> None:
        super().__init__()
        self.classes = classes

    def forward(self, x: Tensor, outputs: Mapping[int, Tensor]) -> Tensor:
        """Return ``x``."""
        return x

    def read(
        self, raw: Raw, size: tuple[int, int]
    ) -> tuple[Float[Tensor, "batch cells 4"], Float[Tensor, "batch cells classes"]]:
        """Boxes (xyxy in pixels) and class logits; ``size`` is the input's (height, width)."""
        rows, columns = raw.shape[2:]
        stride = raw.new_tensor((size[1] / columns, size[0] / rows))
        values = raw.permute(0, 2, 3, 1)
        centres = (values[..., :2] + cell_corners(rows, columns, raw)) * stride
        sizes = values[..., 2:4].clamp(max=LARGEST_EXPONENT).exp() * stride
        boxes = cxcywh_to_xyxy(torch.cat([centres, sizes], dim=-1))
        return boxes.flatten(1, 2), values[..., 4:].flatten(1, 2)

    def candidates(self, raw: Raw, size: tuple[int, int]) -> Candidates:
        """Decode one head; ``size`` is the network's input (height, width) in pixels."""
        boxes, logits = self.read(raw, size)
        return Candidates(boxes, torch.ones_like(logits[..., 0]), logits.sigmoid())

    def start(self, bias: Tensor, prior: float) -> None:
        """Set the bias of the preceding layer for boxes of usual size and scores of ``prior``."""
        bias[:2] = 0.5
        bias[2:4] = math.log(USUAL_SIZE)
        bias[4:] = math.log(prior / (1 - prior))


def anchor_free_head(section: Section, channels: int) -> AnchorFreeHead:
    """Build a head from an ``[anchor_free]`` section with ``channels`` input channels."""
    classes = section.integer("classes", 20, least=1)
    if channels != 4 + classes:
        need = f"4 + {classes} classes need {4 + classes} filters in the layer before"
        raise section.error(f"{need}, found {channels}")
    return AnchorFreeHead(classes)
