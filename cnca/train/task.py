"""What a network in training is to the loop: its data, its loss, its metric, and its recipe."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Generic, TypeVar

import torch
from torch import Tensor, nn

Batch = TypeVar("Batch")

Settings = Mapping[str, int | float | str | bool]
"""What a checkpoint remembers of the training that wrote it."""


@dataclass(frozen=True)
class Recipe:
    """Settings of the optimizer, AdamW (Loshchilov & Hutter 2019), and of its schedule."""

    steps: int
    """Number of steps; the schedule of the step size ends with them."""
    learning_rate: float
    """The largest step size, of all parameters that do not name their own."""
    save_every: int = 200
    """Steps from one checkpoint to the next."""
    warm_up: int = 100
    """Steps over which the step size grows linearly; 0 for none."""
    last_rate: float = 0.02
    """What half a cosine leaves of the step size at the end, as a share."""
    weight_decay: float = 1e-4
    largest_gradient: float = 1.0
    """Norm to which the gradient of all parameters together is clipped; may be infinite."""
    averaging: float | None = 0.99
    """Decay per step of the weights' moving average; None keeps the last weights."""


class Task(ABC, Generic[Batch]):
    """A network in training.

    Whatever is random about a step follows from the generator that it is given: then a training
    that was interrupted goes on exactly as if it had not been.
    """

    name: str
    """In messages, and of the checkpoint."""
    network: nn.Module
    recipe: Recipe
    settings: Settings = MappingProxyType({})
    """What a checkpoint must share with the training that resumes it, besides the seed."""
    divided = False
    """Whether processes of torchrun have a part of each batch, and so of loss and gradient."""

    @abstractmethod
    def batch(self, step: int, rng: torch.Generator) -> Batch:
        """The data of a step."""

    @abstractmethod
    def losses(self, batch: Batch, rng: torch.Generator) -> dict[str, Tensor]:
        """Scalars by name; their sum is minimized."""

    def metrics(self) -> dict[str, float]:
        """How good the network is, quickly measured at every checkpoint; empty by default."""
        return {}

    def parameter_groups(self) -> list[dict[str, Any]]:
        """Parameters as optimizers of torch take them, with ``lr`` where it is another."""
        return [{"params": list(self.network.parameters())}]

    def where(self, step: int) -> str:
        """The name of a step in errors and messages."""
        return f"step {step}"

    def state_dict(self) -> dict[str, Any]:
        """What checkpoints hold besides weights and optimizer."""
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take back what :meth:`state_dict` gave."""
