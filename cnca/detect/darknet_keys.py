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
    "selu": functional.selu,
    "gelu": lambda x: functional.gelu(x, approximate="tanh"),
    "ramp": lambda x: functional.relu(x) + 0.1 * x,
    "loggy": lambda x: 2 * torch.sigmoid(x) - 1,
    "hard_mish": lambda x: torch.where(x > 0, x, 0.5 * x.clamp(min=-2) * (x.clamp(min=-2) + 2)),
}
DARKNETS = ("norm_chan", "norm_chan_softmax", "norm_chan_softmax_maxval", "lhtan", "plse", "stair",
            "hardtan", "revleaky", "relie")  # fmt: skip
"""Others that Darknet has: suggesting a similar one would change the network."""

Features = Float[Tensor, "batch _ _ _"]
Outputs = Mapping[int, Features]
"""Outputs of the layers that later ones refer to, by number."""


def sources(section: Section, key: str, index: int) -> tuple[int, ...]:
    """Absolute numbers of the layers that ``key`` names; negative ones count back from here."""
    numbers = tuple(n if n >= 0 else index + n for n in section.integers(key))
    if not numbers or any(not 0 <= number < index for number in numbers):
        raise section.error(f"{key}={section.text(key, '')} must name earlier layers")
    return numbers


def activation(section: Section, default: str) -> Callable[[Tensor], Tensor]:
    """The function that the key ``activation`` names."""
    name = section.text("activation", default)
    if name not in ACTIVATIONS:
        hint = "" if name in DARKNETS else did_you_mean(name, ACTIVATIONS)
        raise section.error(f"unknown activation '{name}'{hint}")
    return ACTIVATIONS[name]


def shape(x: Features) -> str:
    """The shape for messages, without the batch."""
    return "×".join(map(str, x.shape[1:]))
