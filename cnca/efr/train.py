"""Training of the EFR: Adam, the weighted cross-entropy of the paper, the best epoch kept."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from cnca.color import linear_to_srgb
from cnca.efr.unet import EnvironmentFeatureRenderer, weighted_bce
from cnca.errors import NonFiniteError
from cnca.types import LinearImages

LEARNING_RATE, EPOCHS = 0.01, 20
"""The paper's (section 4.1)."""
HALF_LEVEL = 0.5 / 255
"""Display values nearer to 0 or 1 count as that: there the cross-entropy's slope is endless."""


@dataclass(frozen=True)
class Shot:
    """One view in one weather with several textures; linear, cut out around the vehicle."""

    reference: Float[Tensor, "3 height width"]
    """X_ref."""
    renders: LinearImages
    """X_nr of each texture."""
    truths: LinearImages
    """GT of each texture."""
    mask: Float[Tensor, "1 height width"]
    """1 where the vehicle is, S its sum."""


@dataclass(frozen=True)
class Outcome:
    """What a training came to; errors are mean absolute ones of display values in [0, 1]."""

    network: EnvironmentFeatureRenderer
    """Of the best epoch."""
    before: float
    """Mean absolute error on the test set without EFR."""
    after: list[float]
    """The same after each epoch."""


def train(
    shots: Sequence[Shot],
    test: Sequence[Shot],
    *,
    seed: int,
    epochs: int = EPOCHS,
    after_epoch: Callable[[float, float], None] = lambda loss, error: None,
) -> Outcome:
    """Train on all shots, one shot a step, and keep the epoch with the least test error.

    ``after_epoch`` is given the mean loss and the test error.
    Raises NonFiniteError where a corrected picture is not finite.
    """
    torch.manual_seed(seed)
    network = EnvironmentFeatureRenderer()
    optimizer = torch.optim.Adam(network.parameters(), lr=LEARNING_RATE)
    chance = torch.Generator().manual_seed(seed)
    before, after = mean_absolute_error(network, test), []
    best = copy.deepcopy(network.state_dict())
    for epoch in range(epochs):
        losses = []
        for k in torch.randperm(len(shots), generator=chance).tolist():
            corrected = _corrected(network, shots[k])
            if not torch.isfinite(corrected).all():
                raise NonFiniteError(f"EFR, epoch {epoch}, shot {k}: a picture is not finite")
            loss = _loss(corrected, shots[k])
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            losses.append(loss.item())
        after.append(mean_absolute_error(network, test))
        if after[-1] <= min([before, *after]):
            best = copy.deepcopy(network.state_dict())
        after_epoch(sum(losses) / len(losses), after[-1])
    network.load_state_dict(best)
    return Outcome(network.eval().requires_grad_(False), before, after)


@torch.no_grad()
def mean_absolute_error(network: EnvironmentFeatureRenderer, shots: Sequence[Shot]) -> float:
    """Of display values, over the vehicle's pixels and all shots alike."""
    errors = []
    for shot in shots:
        difference = linear_to_srgb(_corrected(network, shot)) - linear_to_srgb(shot.truths)
        errors.append(
            (difference.abs() * shot.mask).sum() / (3 * len(difference) * shot.mask.sum())
        )
    return float(torch.stack(errors).mean())


def _corrected(network: EnvironmentFeatureRenderer, shot: Shot) -> LinearImages:
    corrected: Tensor = network(shot.renders, shot.reference.expand_as(shot.renders))
    return corrected


def _loss(corrected: LinearImages, shot: Shot) -> Tensor:
    """Equation 10; what is not the vehicle is black in both, as in the paper's masked pictures."""
    mask = shot.mask.expand(len(shot.truths), -1, -1, -1)
    found, truth = (
        linear_to_srgb(x).clamp(HALF_LEVEL, 1 - HALF_LEVEL) * mask for x in (corrected, shot.truths)
    )
    return weighted_bce(found, truth, mask)
