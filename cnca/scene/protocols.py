"""The exchangeable parts.  The loops know these and never a concrete backend."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from cnca.core.detections import ALARM, SUPPRESSION
from cnca.core.types import (
    Boxes,
    Candidates,
    Detections,
    LinearImages,
    LinearTexture,
    PlainPictures,
    SrgbImages,
    SrgbTexture,
)
from cnca.scene.cameras import View
from cnca.scene.layers import Sighting
from cnca.scene.weather import Weather


@runtime_checkable
class Renderer(Protocol):
    """Draws the textured vehicle from several views in one weather."""

    def render(
        self, albedo: LinearTexture, views: Sequence[View], weather: Weather, *, seed: int
    ) -> LinearImages:
        """Return exposed linear images, differentiable in ``albedo`` (values in [0, 1])."""

    def vehicle_boxes(self, views: Sequence[View]) -> Boxes:
        """Return the vehicle's bounding box in each view, xyxy in pixels, shape (views, 4)."""


@runtime_checkable
class SightingRenderer(Renderer, Protocol):
    """A renderer that knows what else with a label stands around the vehicle."""

    def sightings(self, views: Sequence[View]) -> list[list[Sighting]]:
        """Return, of each view, the objects of the world that it shows."""

    def visible_shares(self, views: Sequence[View]) -> list[float]:
        """Return the share of the vehicle in each view that nothing of the world hides."""


@runtime_checkable
class LoopRenderer(Renderer, Protocol):
    """A renderer that comes back to its views, and keeps what a residual needs of them."""

    def reference(
        self, views: Sequence[View], weather: Weather, *, seed: int
    ) -> list[PlainPictures]:
        """Return each view with the plain paint: X_ref, and as ``render`` draws it with ``seed``.

        What does not change is the very same object when its view comes back.
        """


@runtime_checkable
class TextureGenerator(Protocol):
    """Turns a prompt and an adversarial feature F_adv into a texture (paper, equations 7 and 8)."""

    feature_shape: tuple[int, int]
    """Shape (tokens, width) of F_adv."""

    def encode(self, prompt: str) -> Float[Tensor, "tokens width"]:
        """Return F_txt = enc(P_txt), without gradient."""

    def generate(
        self,
        text_feature: Float[Tensor, "tokens width"],
        adversarial_feature: Float[Tensor, "extra width"] | None,
        generator: torch.Generator,
        *,
        together: bool = False,
    ) -> SrgbTexture:
        """Return T2I([F_adv, F_txt]), differentiable in ``adversarial_feature``.

        ``together`` promises that all processes of the job ask for the same texture at once, and
        so may divide the work (:func:`cnca.core.parallel.divided`).
        """


@runtime_checkable
class NoisyTextureGenerator(TextureGenerator, Protocol):
    """One whose noises may be chosen as well: x_T, and those of stochastic DDIM (η = 1)."""

    noise_shape: tuple[int, int, int, int]
    """Shape (draws, channels, height, width) of these noises."""

    def generate(
        self,
        text_feature: Float[Tensor, "tokens width"],
        adversarial_feature: Float[Tensor, "extra width"] | None,
        generator: torch.Generator,
        *,
        noises: Float[Tensor, "draws channels rows columns"] | None = None,
        together: bool = False,
    ) -> SrgbTexture:
        """Return the texture; differentiable in ``noises``, from which nothing is then drawn."""


@runtime_checkable
class Residual(Protocol):
    """Corrects rendered images (the paper's EFR); the identity when absent."""

    def __call__(self, images: LinearImages, references: Sequence[PlainPictures]) -> LinearImages:
        """Return corrected images of the same shape, each by its own reference."""


@runtime_checkable
class Objective(Protocol):
    """What an attack lowers: a loss of each picture, from all that a detector considers in it."""

    def __call__(
        self, candidates: Candidates, vehicle_boxes: Boxes, label: int
    ) -> Float[Tensor, " batch"]:
        """Return the loss of each picture, differentiable in the candidates; any finite number.

        ``vehicle_boxes`` (gt) is where the vehicle is, (batch, 4), xyxy in pixels; ``label`` the
        column of the class scores that it belongs to.
        """


@runtime_checkable
class Detector(Protocol):
    """Finds vehicles.  Resizing, letterboxing and channel order happen inside."""

    name: str
    class_names: Sequence[str]
    differentiable: bool
    """Whether ``candidates`` keeps the autograd graph (white box) or not (black box)."""

    def candidates(self, images: SrgbImages) -> Candidates:
        """Return all boxes before non-maximum suppression, in pixels of ``images``."""

    def detect(
        self,
        images: SrgbImages,
        *,
        score_threshold: float = ALARM,
        iou_threshold: float = SUPPRESSION,
    ) -> list[Detections]:
        """Return the boxes after thresholds and non-maximum suppression, without gradient."""
