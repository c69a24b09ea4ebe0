"""Keys that layers of several kinds have: earlier layers that they refer to, and activations."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from cnca.core.errors import did_you_mean
from cnca.detect.cfg import Section

ACTIVATIONS: dict[str, Callable[[Tensor], Tensor]] = {
    "linear": lambda x: x,
    "leaky": lambda x: functional.leaky_relu(x, 0.1),
    "relu": functional.relu,
    "relu6": functional.relu6,
    "mish": functional.mish,
    "swish": functional.silu,
    "logistic": torch.sigmoid,
    "tanh": torch.tanh,
    "elu": functional.elu,
}

Features = Float[Tensor, "batch _ _ _"]
Outputs = Mapping[int, Features]
"""Of the layers that later ones refer to, by number."""


def sources(section: Section, key: str, index: int) -> tuple[int, ...]:
    """Absolute numbers of the layers that ``key`` names; negative ones count back from here."""
    numbers = tuple(n if n >= 0 else index + n for n in section.integers(key))
    if not numbers or any(not 0 <= number < index for number in numbers):
        raise section.error(f"{key}={section.text(key, '')} must name earlier layers")
    return numbers


def activation(section: Section, default: str) -> Callable[[Tensor], Tensor]:
    """What the key ``activation`` says."""
    name = section.text("activation", default)
    if name not in ACTIVATIONS:
        raise section.error(f"unknown activation '{name}'{did_you_mean(name, ACTIVATIONS)}")
    return ACTIVATIONS[name]


def shape(x: Features) -> str:
    """For messages, without the batch."""
    return "×".join(map(str, x.shape[1:]))
