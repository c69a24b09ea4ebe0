"""Fitting pictures into a detector's input, and its boxes back into the pictures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from cnca.core.types import Boxes, SrgbImages

Fit = Literal["stretch", "letterbox", "corner"]
"""Resize without regard to the aspect ratio; or keep it, with the picture in the middle of the
input; or keep it, with the picture at the top left."""
Triple = tuple[float, float, float]
Resized = Float[Tensor, "batch 3 _ _"]
"""Pictures of another size."""


@dataclass(frozen=True)
class Placement:
    """Where a picture lies in a detector's input: input = picture · scale + offset."""

    scale: tuple[float, float]
    """Input pixels per picture pixel in x and y."""
    offset: tuple[float, float]
    """Left and top of the picture in the input, in pixels."""

    def back(self, boxes: Boxes) -> Boxes:
        """Take xyxy boxes from pixels of the input to pixels of the picture."""
        return (boxes - boxes.new_tensor(self.offset * 2)) / boxes.new_tensor(self.scale * 2)


@dataclass(frozen=True)
class Entry:
    """How display values in [0, 1] become what a network was trained on.

    input = (value · white − mean) / std, the channels in their order at the input.
    """

    channels: Literal["rgb", "bgr"] = "rgb"
    white: float = 1.0
    mean: Triple = (0.0, 0.0, 0.0)
    std: Triple = (1.0, 1.0, 1.0)
    fit: Fit = "stretch"
    fill: float | None = None
    """Grey beside the picture, 0 to 255; None is the color that becomes 0 at the input."""

    def prepare(self, images: SrgbImages, size: tuple[int, int]) -> tuple[Tensor, Placement]:
        """Return the input of ``size`` (height, width), differentiable, and where pictures lie."""
        if self.channels == "bgr":
            images = SrgbImages(images.flip(1))
        mean, std = (images.new_tensor(v)[:, None, None] for v in (self.mean, self.std))
        if self.fit == "stretch":
            fitted, placement = stretch(images, size)
        else:
            color = (
                mean / self.white if self.fill is None else torch.full_like(mean, self.fill / 255)
            )
            fitted, placement = letterbox(images, size, color, centred=self.fit == "letterbox")
        return (fitted * self.white - mean) / std, placement


PLAIN = Entry()
IMAGENET = Entry(mean=(0.485, 0.456, 0.406), std=(0.229, 0.224, 0.225))
"""Mean and deviation of ImageNet's red, green, blue: what most backbones are trained with."""


def stretch(images: SrgbImages, size: tuple[int, int]) -> tuple[Resized, Placement]:
    """Resize to ``size`` (height, width) without regard to the aspect ratio."""
    height, width = size
    scale = (width / images.shape[3], height / images.shape[2])
    return _resize(images, size), Placement(scale, (0.0, 0.0))


def letterbox(
    images: SrgbImages,
    size: tuple[int, int],
    color: Float[Tensor, "3 1 1"] | float,
    *,
    centred: bool,
) -> tuple[Resized, Placement]:
    """Resize into ``size`` (height, width), keep the aspect ratio, fill the rest with ``color``.

    The picture lies in the middle, or else at the top left.
    """
    height, width = size
    ratio = min(width / images.shape[3], height / images.shape[2])
    inner = (max(1, int(images.shape[2] * ratio)), max(1, int(images.shape[3] * ratio)))
    top, left = ((height - inner[0]) // 2, (width - inner[1]) // 2) if centred else (0, 0)
    border = (left, width - inner[1] - left, top, height - inner[0] - top)
    resized = functional.pad(_resize(images, inner) - color, border) + color
    scale = (inner[1] / images.shape[3], inner[0] / images.shape[2])
    return resized, Placement(scale, (float(left), float(top)))


def _resize(images: SrgbImages, size: tuple[int, int]) -> Resized:
    if tuple(images.shape[2:]) == size:
        return images
    # Anti-aliased, so that every pixel of the picture counts and receives a gradient.
    return functional.interpolate(
        images, size, mode="bilinear", align_corners=False, antialias=True
    )
