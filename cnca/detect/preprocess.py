"""Fitting pictures into a detector's input, and its boxes back into the pictures."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from cnca.types import Boxes, SrgbImages


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


def stretch(images: SrgbImages, size: tuple[int, int]) -> tuple[SrgbImages, Placement]:
    """Resize to ``size`` (height, width) without regard to the aspect ratio."""
    height, width = size
    scale = (width / images.shape[3], height / images.shape[2])
    return _resize(images, size), Placement(scale, (0.0, 0.0))


def letterbox(
    images: SrgbImages, size: tuple[int, int], *, grey: float, centred: bool
) -> tuple[SrgbImages, Placement]:
    """Resize into ``size`` (height, width), keep the aspect ratio, fill the rest with ``grey``.

    The picture lies in the middle, or else at the top left.
    """
    height, width = size
    ratio = min(width / images.shape[3], height / images.shape[2])
    inner = (max(1, int(images.shape[2] * ratio)), max(1, int(images.shape[3] * ratio)))
    top, left = ((height - inner[0]) // 2, (width - inner[1]) // 2) if centred else (0, 0)
    border = (left, width - inner[1] - left, top, height - inner[0] - top)
    resized = functional.pad(_resize(images, inner), border, value=grey)
    scale = (inner[1] / images.shape[3], inner[0] / images.shape[2])
    return resized, Placement(scale, (float(left), float(top)))


def _resize(
    images: SrgbImages, size: tuple[int, int]
) -> Float[Tensor, "batch 3 new_height new_width"]:
    if tuple(images.shape[2:]) == size:
        return images
    # Anti-aliased, so that every pixel of the picture counts and receives a gradient.
    return functional.interpolate(
        images, size, mode="bilinear", align_corners=False, antialias=True
    )
