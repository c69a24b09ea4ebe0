"""Training of the EFR: Adam, the weighted cross-entropy of the paper, the best epoch kept."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
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
from cnca.train.loop import TrainingLoop
from cnca.train.task import Recipe, Task

LEARNING_RATE, EPOCHS = 0.01, 20
"""The paper's (section 4.1); ours falls to 0 along half a cosine."""
GAIN_RATE = 0.1
"""For the gains of what the renderer leaves out: six numbers that all pixels agree on."""
HALF_LEVEL = 0.5 / 255
"""Display values are kept this far from 0 and 1, where the cross-entropy's slope is unbounded."""


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
    """The result of a training; errors are mean absolute differences of display values."""

    network: EnvironmentFeatureRenderer
    """Of the best epoch."""
    before: Float[Tensor, " pictures"]
    """Mean absolute error of each test picture without EFR."""
    after: list[Float[Tensor, " pictures"]]
    """The same after each epoch."""

    @property
    def best(self) -> Float[Tensor, " pictures"]:
        """Errors of the epoch that is kept; those without EFR where no epoch lowers them."""
        return min([self.before, *self.after], key=lambda errors: float(errors.mean()))


class EfrTask(Task[Shot]):
    """Learns to correct renders, one shot a step; remembers the epoch with the least test error.

    Under torchrun the processes divide each shot's pictures and take the same steps.
    """

    name = "efr"
    divided = True
    network: EnvironmentFeatureRenderer

    def __init__(
        self, shots: Sequence[Shot], test: Sequence[Shot], *, seed: int, epochs: int
    ) -> None:
        torch.manual_seed(seed)
        self.network = EnvironmentFeatureRenderer()
        self.recipe = Recipe(
            epochs * len(shots),
            LEARNING_RATE,
            save_every=len(shots),
            warm_up=0,
            last_rate=0.0,
            weight_decay=0.0,
            largest_gradient=math.inf,
            averaging=None,
        )
        rng = torch.Generator().manual_seed(seed)
        self._order = [torch.randperm(len(shots), generator=rng).tolist() for _ in range(epochs)]
        self._shots, self._test = shots, test
        self.before = absolute_errors(self.network, test)
        self.after: list[Float[Tensor, " pictures"]] = []
        self.best = copy.deepcopy(self.network.state_dict())
        self.settings = {"shots": len(shots), "test_shots": len(test)}

    def batch(self, step: int, rng: torch.Generator) -> Shot:
        """The next shot of the epoch's order."""
        return self._shots[self._shot(step)]

    def losses(self, batch: Shot, rng: torch.Generator) -> dict[str, Tensor]:
        """Equation 10, of this process's pictures."""
        shot, part = _share(batch)
        corrected = _corrected(self.network, shot)
        if not torch.isfinite(corrected).all():  # its cross-entropy would be undefined
            raise NonFiniteError("a corrected picture is not finite")
        return {"L_EFR": part * _loss(corrected, shot)}

    def metrics(self) -> dict[str, float]:
        """The test error after an epoch, which is kept if it is the least."""
        self.after.append(absolute_errors(self.network, self._test))
        if all(self.after[-1].mean() <= errors.mean() for errors in (self.before, *self.after)):
            self.best = copy.deepcopy(self.network.state_dict())
        return {"test error": float(self.after[-1].mean())}

    def parameter_groups(self) -> list[dict[str, Any]]:
        """The gains take larger steps."""
        gains = [self.network.left_out, self.network.slope]
        maps = [p for p in self.network.parameters() if all(p is not gain for gain in gains)]
        return [{"params": maps}, {"params": gains, "lr": GAIN_RATE}]

    def where(self, step: int) -> str:
        """Epochs are counted from 1."""
        return f"epoch {step // len(self._shots) + 1}, shot {self._shot(step)}"

    def state_dict(self) -> dict[str, Any]:
        """The errors so far, and the weights of the best epoch."""
        return {"before": self.before, "after": self.after, "best": self.best}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take them back."""
        self.before, self.after, self.best = (state[k] for k in ("before", "after", "best"))

    def _shot(self, step: int) -> int:
        epoch, index = divmod(step, len(self._shots))
        return self._order[epoch][index]


def train(
    loop: TrainingLoop, shots: Sequence[Shot], test: Sequence[Shot], *, epochs: int = EPOCHS
) -> Outcome:
    """Train on all shots and keep the epoch with the least test error.

    Raises NonFiniteError where the loss or its gradient is not finite, and RunError where ``loop``
    resumes another training.
    """
    task = EfrTask(shots, test, seed=loop.seed, epochs=epochs)
    loop.run(task)
    task.network.load_state_dict(task.best)
    return Outcome(task.network.eval().requires_grad_(False), task.before, task.after)


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
    return Shot(shot.plain, LinearImages(renders), LinearImages(truths), shot.mask), len(
        renders
    ) / len(shot.renders)


def _corrected(network: EnvironmentFeatureRenderer, shot: Shot) -> LinearImages:
    return network.correction(shot.plain)(shot.renders)


def _loss(corrected: LinearImages, shot: Shot) -> Tensor:
    """Equation 10; what is not the vehicle is black in both, as in the paper's masked pictures."""
    mask = shot.mask.expand(len(shot.truths), -1, -1, -1)
    drawn, truth = (
        linear_to_srgb(x).clamp(HALF_LEVEL, 1 - HALF_LEVEL) * mask for x in (corrected, shot.truths)
    )
    return weighted_bce(drawn, truth, mask)
