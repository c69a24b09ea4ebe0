"""The one training loop: schedule, averaged weights, checkpoints, finiteness, progress.

    θ ← θ − AdamW(∇ L(batch of step i; θ)),  step size η_i = η · min(1, (i + 1) / w) · cosine(i / n)

with w steps of warm-up out of n.  A ``Task`` says what is learned, and from what.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from rich.console import Console
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from cnca.core import parallel
from cnca.core.errors import NonFiniteError, RunError
from cnca.core.files import replacing
from cnca.core.progress import bar
from cnca.train.task import Batch, Recipe, Task

Tensors = list[Tensor] | tuple[Tensor, ...]
RECENT = 50
"""Steps over which messages average the loss."""


@dataclass(frozen=True)
class TrainingLoop:
    """Trains tasks, each with a checkpoint of its name in ``folder``.

    The jobs claim the folder, and record the files that a training starts from (``RunFolder``).

    Step i draws all its random numbers from generators seeded with (seed, i), torch's global one
    included, from which layers such as dropout draw.
    """

    folder: Path | None
    """Where ``NAME.pt`` is kept; None keeps no checkpoints."""
    seed: int
    resume: bool = False
    console: Console | None = None
    """For progress; stderr by default."""

    def __post_init__(self) -> None:
        """Raises RunError where the folder holds a training that is not to be resumed."""
        if self.folder and not self.resume and any(self.folder.glob("*.pt")):
            raise RunError(
                f"{self.folder}: already holds a training; add --resume or choose another --out"
            )

    def run(self, task: Task[Batch]) -> nn.Module:
        """Train ``task.network`` in place; return it, or its moving average if there is one.

        Raises:
            NonFiniteError: a loss or gradient is NaN or infinite.
            RunError: the checkpoint is damaged or of another training.
        """
        state = TrainingState(task, self.seed)
        first = state.load(self._checkpoint(task)) if self.resume else 0
        recipe, recent = task.recipe, 0.0
        with bar(self.console) as progress, torch.random.fork_rng(devices=[]):
            task_bar = progress.add_task(task.name, total=recipe.steps, completed=first)
            for step in range(first, recipe.steps):
                loss = state.step(step)
                recent += (loss - recent) / min(step - first + 1, RECENT)
                label = f"{task.name} loss {recent:.4f}"
                progress.update(task_bar, advance=1, description=label)
                if (step + 1) % recipe.save_every == 0 or step + 1 == recipe.steps:
                    numbers = "".join(f", {k} {v:.4f}" for k, v in task.metrics().items())
                    state.save(self._checkpoint(task), step + 1)
                    remaining = progress.tasks[task_bar].time_remaining or 0.0
                    progress.console.print(
                        f"{label}{numbers}, {task.where(step)} done, {remaining:.0f} s left"
                    )
        return state.averaged.module if state.averaged else task.network

    def _checkpoint(self, task: Task[Any]) -> Path | None:
        return self.folder / f"{task.name}.pt" if self.folder else None


class TrainingState:
    """What a checkpoint holds: weights, their average, the optimizer's memory, the task's own."""

    def __init__(self, task: Task[Any], seed: int) -> None:
        recipe = task.recipe
        self.task, self.seed = task, seed
        self.settings = {"seed": seed, **task.settings}
        self.optimizer = torch.optim.AdamW(
            task.parameter_groups(), lr=recipe.learning_rate, weight_decay=recipe.weight_decay
        )
        self._rates = [group["lr"] for group in self.optimizer.param_groups]
        self.averaged: AveragedModel | None = None
        if recipe.averaging is not None:
            average = moving_average(recipe.averaging)
            self.averaged = AveragedModel(task.network, multi_avg_fn=average, use_buffers=True)

    def step(self, step: int) -> float:
        """Take one step of the optimizer and return the loss before it."""
        task, recipe = self.task, self.task.recipe
        seed = self.seed * 1_000_003 + step
        torch.manual_seed(seed)
        rng = torch.Generator().manual_seed(seed)
        for group, rate in zip(self.optimizer.param_groups, self._rates, strict=True):
            group["lr"] = rate * rate_factor(step, recipe)
        task.network.train()
        try:
            losses = task.losses(task.batch(step, rng), rng)
        except NonFiniteError as error:
            raise NonFiniteError(f"{self._where(step)}: {error}") from error
        loss = torch.stack(list(losses.values())).sum()
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        if task.divided:
            parallel.add_up(*(p.grad for p in task.network.parameters()), loss)
        length = nn.utils.clip_grad_norm_(task.network.parameters(), recipe.largest_gradient)
        self._check(step, {**losses, "gradient": length})
        self.optimizer.step()
        if self.averaged:
            self.averaged.update_parameters(task.network)
        return loss.item()

    def _check(self, step: int, values: dict[str, Tensor]) -> None:
        for name, value in values.items():
            if not bool(torch.isfinite(value)):
                raise NonFiniteError(f"{self._where(step)}: {name} is {value.item()}")

    def _where(self, step: int) -> str:
        return f"training of {self.task.name}, {self.task.where(step)}"

    def save(self, file: Path | None, done: int) -> None:
        """Write a checkpoint after ``done`` steps; of several processes the first does."""
        if file is None or parallel.rank():
            return
        state = {name: part.state_dict() for name, part in self._parts().items()}
        with replacing(file) as temporary:
            torch.save({"step": done, "settings": self.settings, **state}, temporary)

    def load(self, file: Path | None) -> int:
        """Take back the last checkpoint, if there is one, and return the number of steps done."""
        if file is None or not file.exists():
            return 0
        try:
            saved = torch.load(file, weights_only=True)
            settings, step = dict(saved["settings"]), int(saved["step"])
            if settings == self.settings:
                for name, part in self._parts().items():
                    part.load_state_dict(saved[name])
        except Exception as error:  # damaged content makes torch raise errors of any kind
            reason = (str(error).splitlines() or [type(error).__name__])[0]
            raise RunError(
                f"{file}: not a checkpoint of this model ({reason}); remove it"
            ) from error
        for key in sorted(settings.keys() | self.settings.keys()):
            before, now = settings.get(key), self.settings.get(key)
            if before != now:
                raise RunError(f"{file}: was trained with {key}={before}, not {now}; remove it")
        return step

    def _parts(self) -> dict[str, nn.Module | torch.optim.Optimizer | Task[Any]]:
        parts: dict[str, nn.Module | torch.optim.Optimizer | Task[Any]]
        parts = {"network": self.task.network, "optimizer": self.optimizer, "task": self.task}
        return parts if self.averaged is None else parts | {"averaged": self.averaged}


def rate_factor(step: int, recipe: Recipe) -> float:
    """Share of the step size: linear warm-up times half a cosine (Loshchilov & Hutter 2017)."""
    cosine = 0.5 + 0.5 * math.cos(math.pi * step / recipe.steps)
    growing = min(1.0, (step + 1) / recipe.warm_up) if recipe.warm_up else 1.0
    return growing * (recipe.last_rate + (1.0 - recipe.last_rate) * cosine)


def moving_average(decay: float) -> Any:
    """Exponential moving average in place; it forgets faster during the first steps."""

    def average(averaged: Tensors, current: Tensors, steps: Tensor | int) -> None:
        done = int(steps)
        get_ema_multi_avg_fn(min(decay, (1 + done) / (10 + done)))(averaged, current, steps)

    return average
