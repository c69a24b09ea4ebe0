"""Records that pass between the parts, with their shapes, units and value ranges.

Color spaces are types of their own: ``Srgb…`` values are display-encoded and lie in [0, 1],
``Linear…`` values are proportional to radiance (images, ≥ 0) or are reflectances (albedo, [0, 1]).
mypy takes none for another, nor a bare tensor for any: :mod:`cnca.core.color` converts, and
``LinearImages(tensor)`` says what a tensor is where one begins; at run time that does nothing.
Pixel boxes are ``xyxy`` (left, top, right, bottom) with the origin at the image's top left corner.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NewType

from jaxtyping import Float, Int
from torch import Tensor

SrgbImages = NewType("SrgbImages", Float[Tensor, "batch 3 height width"])
"""Display-encoded pictures in [0, 1], channels first: what detectors and people look at."""

LinearImages = NewType("LinearImages", Float[Tensor, "batch 3 height width"])
"""Linear radiance times the scene's exposure, ≥ 0, channels first: what renderers return."""

SrgbTexture = NewType("SrgbTexture", Float[Tensor, "3 _ _"])
"""A UV texture as an ordinary picture in [0, 1]; row 0 is v = 1 (the top of the image file)."""

LinearTexture = NewType("LinearTexture", Float[Tensor, "3 _ _"])
"""A UV texture as linear albedo in [0, 1]; row 0 is v = 1."""

Boxes = Float[Tensor, "... 4"]
"""Pixel boxes, xyxy."""


@dataclass(frozen=True)
class Candidates:
    """Every box that a detector considers, before thresholds and non-maximum suppression.

    The attributes keep the autograd graph when the detector is differentiable.
    """

    boxes: Float[Tensor, "batch candidates 4"]
    """xyxy in pixels of the image that was given, D_b in the paper."""
    objectness: Float[Tensor, "batch candidates"]
    """D_o in [0, 1]; ones for detectors without such an output."""
    class_scores: Float[Tensor, "batch candidates classes"]
    """D_c in [0, 1], one column for each of the detector's ``class_names``."""


@dataclass(frozen=True)
class Detections:
    """What a detector reports in one image, best first."""

    boxes: Float[Tensor, "found 4"]
    """xyxy in pixels of the image that was given."""
    scores: Float[Tensor, " found"]
    """Confidence D_c · D_o in [0, 1]."""
    labels: Int[Tensor, " found"]
    """Index into the detector's ``class_names``."""

    def of(self, label: int) -> Detections:
        """The detections of one class only."""
        return self._where(self.labels == label)

    def above(self, score: float) -> Detections:
        """The detections with at least this confidence."""
        return self._where(self.scores >= score)

    def _where(self, keep: Tensor) -> Detections:
        return Detections(self.boxes[keep], self.scores[keep], self.labels[keep])


@dataclass(frozen=True, eq=False)
class PlainPictures:
    """The vehicle in its plain paint, in one view, without gradient; batches of one."""

    traced: LinearImages
    """X_ref: path-traced, clean, over the same backgrounds."""
    drawn: LinearImages
    """X_nr of that paint: as the loop's own renderer draws it."""
