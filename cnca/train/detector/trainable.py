"""What a training needs of a detector: network, losses, and the files that it becomes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import Self

import torch
from jaxtyping import Float
from torch import Tensor, nn

from cnca.train.detector.dataset import LabelledPictures
from cnca.train.detector.yolo_loss import Targets


class TrainableDetector(ABC):
    """One family of detectors in training."""

    network: nn.Module
    size: tuple[int, int]
    """Height and width of the network's input in pixels."""
    learning_rate: float
    """The optimizer's largest step size."""
    classes: int
    """How many classes it tells apart: the first ones of the data."""

    @classmethod
    @abstractmethod
    def begin(cls, data: LabelledPictures, template: Path, out: Path, seed: int) -> Self:
        """A new network of ``template`` for the classes of ``data``, to be saved into ``out``."""

    @classmethod
    @abstractmethod
    def fine_tune(cls, data: LabelledPictures, template: Path, out: Path, seed: int) -> Self:
        """The same with the weights of ``template``."""

    @abstractmethod
    def losses(
        self, images: Float[Tensor, "batch 3 height width"], targets: Targets, *, bfloat16: bool
    ) -> dict[str, Float[Tensor, ""]]:
        """Return the losses by name; their sum is minimized.

        ``images`` are sRGB in [0, 1] of the network's size; ``bfloat16`` lets convolutions use it.
        """

    @abstractmethod
    def save(self, network: nn.Module) -> Path:
        """Write ``network`` (of the same kind) and return what names it to ``load_detector``."""


def autocast(images: Tensor, bfloat16: bool) -> torch.autocast:
    """The context in which a forward pass may use bfloat16."""
    return torch.autocast(images.device.type, torch.bfloat16, enabled=bfloat16)
