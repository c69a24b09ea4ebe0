"""Training of the EFR: Adam, the weighted cross-entropy of the paper, the best epoch kept."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from cnca.core import parallel
from cnca.core.color import linear_to_srgb
from cnca.core.errors import NonFiniteError
from cnca.core.types import LinearImages, PlainPictures
from cnca.efr.unet import EnvironmentFeatureRenderer, weighted_bce

LEARNING_RATE, EPOCHS = 0.01, 20
"""The paper's (section 4.1); ours falls to 0 along half a cosine."""
GAIN_RATE = 0.1
"""For the gains of what the renderer leaves out: six numbers that all pixels agree on."""
HALF_LEVEL = 0.5 / 255
"""Display values nearer to 0 or 1 count as that: there the cross-entropy's slope is endless."""


@dataclass(frozen=True)
class Shot:
    """One view in one weather with several textures; linear, cut out around the vehicle."""

    plain: PlainPictures
    """X_ref, and X_nr of its paint."""
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
    before: Float[Tensor, " pictures"]
    """Mean absolute error of each test picture without EFR."""
    after: list[Float[Tensor, " pictures"]]
    """The same after each epoch."""

    @property
    def best(self) -> Float[Tensor, " pictures"]:
        """Those of the epoch that is kept; of none, where all of them only harm."""
        return min([self.before, *self.after], key=lambda errors: float(errors.mean()))


def train(
    shots: Sequence[Shot],
    test: Sequence[Shot],
    *,
    seed: int,
    epochs: int = EPOCHS,
    after_epoch: Callable[[float, float], None] = lambda loss, error: None,
) -> Outcome:
    """Train on all shots, one shot a step, and keep the epoch with the least test error.

    Under torchrun the processes divide each shot's pictures and take the same steps.

    ``after_epoch`` is given the mean loss and the test error.
    Raises NonFiniteError where a corrected picture is not finite.
    """
    torch.manual_seed(seed)
    network = EnvironmentFeatureRenderer()
    gains = [network.left_out, network.slope]
    maps = [p for p in network.parameters() if all(p is not gain for gain in gains)]
    groups: list[dict[str, Any]] = [{"params": maps}, {"params": gains, "lr": GAIN_RATE}]
    optimizer = torch.optim.Adam(groups, lr=LEARNING_RATE)
    rate = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, epochs * len(shots))
    chance = torch.Generator().manual_seed(seed)
    before, after = absolute_errors(network, test), []
    best = copy.deepcopy(network.state_dict())
    for epoch in range(epochs):
        losses = []
        for k in torch.randperm(len(shots), generator=chance).tolist():
            own, part = _share(shots[k])
            corrected = _corrected(network, own)
            if not torch.isfinite(corrected).all():
                raise NonFiniteError(f"EFR, epoch {epoch}, shot {k}: a picture is not finite")
            loss = part * _loss(corrected, own)
            optimizer.zero_grad()
            loss.backward()
            parallel.add_up(*(p.grad for p in network.parameters()), loss)
            optimizer.step()
            rate.step()
            losses.append(loss.item())
        after.append(absolute_errors(network, test))
        if all(after[-1].mean() <= errors.mean() for errors in (before, *after)):
            best = copy.deepcopy(network.state_dict())
        after_epoch(sum(losses) / len(losses), float(after[-1].mean()))
    network.load_state_dict(best)
    return Outcome(network.eval().requires_grad_(False), before, after)


@torch.no_grad()
def absolute_errors(
    network: EnvironmentFeatureRenderer, shots: Sequence[Shot]
) -> Float[Tensor, " pictures"]:
    """Mean absolute error of display values over the vehicle's pixels, of each picture."""
    errors = []
    for shot in parallel.share(shots):
        difference = linear_to_srgb(_corrected(network, shot)) - linear_to_srgb(shot.truths)
        errors.append((difference.abs() * shot.mask).mean(dim=(1, 2, 3)) / shot.mask.mean())
    return torch.cat(parallel.gathered(errors))


def _share(shot: Shot) -> tuple[Shot, float]:
    """This process's pictures and their part of all; where there are too few, all for each."""
    if len(shot.renders) < parallel.count():
        return shot, 1 / parallel.count()
    renders, truths = parallel.share(shot.renders), parallel.share(shot.truths)
    return Shot(shot.plain, renders, truths, shot.mask), len(renders) / len(shot.renders)


def _corrected(network: EnvironmentFeatureRenderer, shot: Shot) -> LinearImages:
    return network.correction(shot.plain)(shot.renders)


def _loss(corrected: LinearImages, shot: Shot) -> Tensor:
    """Equation 10; what is not the vehicle is black in both, as in the paper's masked pictures."""
    mask = shot.mask.expand(len(shot.truths), -1, -1, -1)
    found, truth = (
        linear_to_srgb(x).clamp(HALF_LEVEL, 1 - HALF_LEVEL) * mask for x in (corrected, shot.truths)
    )
    return weighted_bce(found, truth, mask)
