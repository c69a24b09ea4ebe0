"""One training loop for both stages: optimizer, averaged weights, checkpoints, progress."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar, cast

import torch
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from cnca.core.errors import NonFiniteError, RunError
from cnca.core.files import replacing
from cnca.core.progress import bar

Trained = TypeVar("Trained", bound=nn.Module)


@dataclass(frozen=True)
class TrainingLoop:
    """AdamW with a warm-up and a cosine decay; weights averaged exponentially.

    Step i draws all its random numbers from a generator seeded with (seed, i): a run that was
    interrupted goes on exactly as if it had not been.
    """

    folder: Path
    """Where ``<stage>.pt`` is kept."""
    seed: int
    resume: bool
    save_every: int = 200
    warm_up: int = 100

    def __post_init__(self) -> None:
        """Raises RunError where the folder holds a training that is not to be resumed."""
        if not self.resume and any(self.folder.glob("*.pt")):
            raise RunError(
                f"{self.folder}: already holds a training; add --resume or choose another --out"
            )

    def run(
        self,
        stage: str,
        model: Trained,
        loss: Callable[[torch.Generator], Tensor],
        *,
        steps: int,
        learning_rate: float,
        average: float,
    ) -> Trained:
        """Train ``model`` in place for ``steps`` and return the averaged copy.

        ``loss`` maps the step's generator to a scalar; ``average`` is the decay per step.
        """
        averaged = AveragedModel(model, multi_avg_fn=get_ema_multi_avg_fn(average))
        optimizer = torch.optim.AdamW(model.parameters(), lr=learning_rate, weight_decay=1e-4)
        state = {"model": model, "averaged": averaged, "optimizer": optimizer}
        first = self._restore(stage, state) if self.resume else 0
        with bar() as progress:
            task = progress.add_task(stage, total=steps, completed=first)
            recent = 0.0
            for step in range(first, steps):
                for group in optimizer.param_groups:
                    group["lr"] = learning_rate * self._schedule(step, steps)
                value = loss(torch.Generator().manual_seed(self.seed * 1_000_003 + step))
                if not torch.isfinite(value):
                    raise NonFiniteError(f"the loss of {stage} is {value.item()} at step {step}")
                optimizer.zero_grad(set_to_none=True)
                value.backward()
                nn.utils.clip_grad_norm_(model.parameters(), 1.0)
                optimizer.step()
                averaged.update_parameters(model)
                recent += (value.item() - recent) / min(step - first + 1, 50)
                progress.update(task, advance=1, description=f"{stage} loss {recent:.4f}")
                if (step + 1) % self.save_every == 0 or step + 1 == steps:
                    self._save(stage, state, step + 1)
                    remaining = progress.tasks[task].time_remaining or 0.0
                    progress.console.print(
                        f"{stage} step {step + 1}/{steps} loss {recent:.4f}, {remaining:.0f} s left"
                    )
        return cast(Trained, averaged.module)

    def _schedule(self, step: int, steps: int) -> float:
        cosine = 0.5 + 0.5 * math.cos(math.pi * step / steps)
        return min(1.0, (step + 1) / self.warm_up) * (0.02 + 0.98 * cosine)

    def _save(self, stage: str, state: dict, step: int) -> None:
        weights = {name: part.state_dict() for name, part in state.items()}
        with replacing(self.folder / f"{stage}.pt") as temporary:
            torch.save({"step": step, **weights}, temporary)

    def _restore(self, stage: str, state: dict) -> int:
        """Load the last checkpoint, if there is one, and return the number of steps done."""
        file = self.folder / f"{stage}.pt"
        if not file.exists():
            return 0
        try:
            saved = torch.load(file, weights_only=True)
            for name, part in state.items():
                part.load_state_dict(saved[name])
            return saved["step"]
        except Exception as error:  # torch raises whatever damaged content makes it raise
            raise RunError(f"{file}: not a checkpoint of this model; remove it") from error
