"""YOLOv3's anchor-based head (Redmon & Farhadi 2018, section 2.1)."""

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

LARGEST_EXPONENT = 8.0
"""Bound on t_w and t_h: a box is at most e⁸ ≈ 2981 anchors wide, and exp cannot overflow."""


class YoloHead(nn.Module):
    """Marks a place where boxes are read off; passes its input on unchanged."""

    def __init__(
        self,
        anchors: list[tuple[float, float]],
        classes: int,
        scale_xy: float,
        *,
        new_coords: bool = False,
    ) -> None:
        """``anchors`` are widths and heights in pixels of the network's input.

        ``new_coords`` (scaled YOLOv4, Wang et al. 2021, and YOLOv7): the preceding layer has
        already taken the logistic function of everything, and sizes are (2 t)² times the anchors.
        """
        super().__init__()
        self.new_coords = new_coords
        self.anchors = anchors
        self.classes = classes
        self.scale_xy = scale_xy

    def forward(self, x: Tensor, outputs: Mapping[int, Tensor]) -> Tensor:
        """Return ``x``."""
        return x

    def split(
        self, raw: Float[Tensor, "batch outputs rows columns"]
    ) -> Float[Tensor, "batch anchors rows columns values"]:
        """The outputs (t_x, t_y, t_w, t_h, objectness, classes…) of every anchor and cell."""
        batch, _, rows, columns = raw.shape
        values = 5 + self.classes
        return raw.view(batch, -1, values, rows, columns).permute(0, 1, 3, 4, 2)

    def boxes(
        self, split: Float[Tensor, "batch anchors rows columns values"], stride: tuple[float, float]
    ) -> Float[Tensor, "batch anchors rows columns 4"]:
        """xyxy in pixels of the network's input; ``stride`` is a cell's (width, height) in them."""
        cells = cell_corners(split.shape[2], split.shape[3], split)
        # scale_x_y lets centres reach the cell's border (Bochkovskiy et al. 2020, section 3.3).
        inside = self._probability(split[..., :2]) * self.scale_xy - (self.scale_xy - 1) / 2
        centres = (cells + inside) * split.new_tensor(stride)
        anchors = split.new_tensor(self.anchors)[None, :, None, None, :]
        if self.new_coords:
            sizes = (2 * split[..., 2:4]).square() * anchors
        else:
            sizes = split[..., 2:4].clamp(max=LARGEST_EXPONENT).exp() * anchors
        return cxcywh_to_xyxy(torch.cat([centres, sizes], dim=-1))

    def start(self, bias: Tensor, prior: float) -> None:
        """Set the bias of the preceding layer so that objectness is ``prior`` everywhere."""
        bias.view(-1, 5 + self.classes)[:, 4] = math.log(prior / (1 - prior))

    def candidates(
        self, raw: Float[Tensor, "batch outputs rows columns"], size: tuple[int, int]
    ) -> Candidates:
        """Decode one head; ``size`` is the network's input (height, width) in pixels."""
        split = self.split(raw)
        stride = (size[1] / split.shape[3], size[0] / split.shape[2])
        return Candidates(
            boxes=self.boxes(split, stride).flatten(1, 3),
            objectness=self._probability(split[..., 4]).flatten(1),
            class_scores=self._probability(split[..., 5:]).flatten(1, 3),
        )

    def _probability(self, values: Tensor) -> Tensor:
        return values.clamp(0, 1) if self.new_coords else values.sigmoid()


def yolo_head(section: Section, channels: int) -> YoloHead:
    """Build a head from a ``[yolo]`` section with ``channels`` input channels."""
    values = section.numbers("anchors")
    pairs = list(zip(values[0::2], values[1::2], strict=False))
    expected = 2 * section.integer("num", len(pairs))
    if not values or len(values) != expected or min(values) <= 0:
        raise section.error("anchors must be num pairs of positive widths and heights")
    mask = section.integers("mask") if "mask" in section.options else range(len(pairs))
    if not mask or any(not 0 <= index < len(pairs) for index in mask):
        raise section.error(f"mask must pick from the {len(pairs)} anchors")
    classes = section.integer("classes", 20, least=1)
    if channels != len(mask) * (5 + classes):
        raise section.error(
            f"{len(mask)} anchors × (5 + {classes} classes) need {len(mask) * (5 + classes)} "
            f"filters in the layer before, found {channels}"
        )
    return YoloHead(
        [pairs[i] for i in mask],
        classes,
        section.number("scale_x_y", 1.0),
        new_coords=bool(section.integer("new_coords", 0)),
    )
