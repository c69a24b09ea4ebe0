"""Training a detector from scratch."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from torch.optim import AdamW
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn
from torch.utils.data import DataLoader

from cnca.core.errors import DetectorError, NonFiniteError, RunError
from cnca.core.files import replacing, write_text
from cnca.core.progress import bar
from cnca.detect import BUILTIN, BUILTINS, load_detector
from cnca.train.darknet_subject import DarknetSubject
from cnca.train.dataset import TRAIN, LabelledPictures, TrainingPictures, collate
from cnca.train.measure import measure
from cnca.train.subject import Subject
from cnca.train.yolo_loss import Targets

Tensors = list[torch.Tensor] | tuple[torch.Tensor, ...]

WARM_UP, WEIGHT_DECAY, AVERAGING = 0.05, 0.02, 0.998
LARGEST_GRADIENT = 10.0
FINE_TUNING = 0.25
"""Step size of fine-tuning relative to that of a training from scratch."""


@dataclass(frozen=True)
class Settings:
    """What decides the outcome of a training, apart from the data."""

    epochs: int = 20
    minutes: float | None = None
    """Training ends after so long, if that is sooner; the learning rate falls accordingly."""
    batch: int = 32
    seed: int = 0
    bfloat16: bool = True
    """Convolve in bfloat16 (several times faster on processors with AMX)."""
    fine_tune: bool = False
    """Begin with the template's own weights and anchors, and take smaller steps."""

    def __post_init__(self) -> None:
        if self.epochs < 1:
            raise RunError(f"--epochs {self.epochs}: a training needs at least one")


class Training:
    """The state that a checkpoint holds: network, its moving average, optimizer, progress."""

    def __init__(self, subject: Subject, settings: Settings) -> None:
        self.settings = settings
        self.subject = subject
        self.network = subject.network
        self.network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.average = AveragedModel(self.network, multi_avg_fn=moving_average, use_buffers=True)
        self.optimizer = AdamW(self.network.parameters(), weight_decay=WEIGHT_DECAY)
        self.epoch = 0
        self.seconds = 0.0

    def progress(self, within_epoch: float, seconds: float) -> float:
        """How much of the training is done, in [0, 1], by epochs or by time."""
        done = (self.epoch + within_epoch) / self.settings.epochs
        limit = self.settings.minutes
        return min(1.0, max(done, seconds / (60 * limit) if limit else 0.0))

    def step(self, images: torch.Tensor, targets: Targets, progress: float) -> dict[str, float]:
        """One step of the optimizer; returns the losses by name."""
        rate = self.subject.learning_rate * (FINE_TUNING if self.settings.fine_tune else 1.0)
        for group in self.optimizer.param_groups:
            group["lr"] = rate * rate_factor(progress)
        self.network.train()
        images = images.contiguous(memory_format=torch.channels_last)
        losses = self.subject.losses(images, targets, bfloat16=self.settings.bfloat16)
        loss = torch.stack(list(losses.values())).sum()
        if not bool(loss.isfinite()):
            raise NonFiniteError(f"detector training: loss is {loss.item()} in epoch {self.epoch}")
        self.optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), LARGEST_GRADIENT)
        self.optimizer.step()
        self.average.update_parameters(self.network)
        return {name: value.item() for name, value in losses.items()}

    def save(self, path: Path) -> None:
        """Write a checkpoint under a temporary name, then rename."""
        state = {
            "settings": asdict(self.settings),
            "network": self.network.state_dict(),
            "average": self.average.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "epoch": self.epoch,
            "seconds": self.seconds,
        }
        with replacing(path) as temporary:
            torch.save(state, temporary)

    def load(self, path: Path) -> None:
        """Continue from a checkpoint of the same settings (length and time limit may differ)."""
        try:
            state = torch.load(path, weights_only=True)
            for key in ("batch", "seed", "bfloat16"):
                if state["settings"][key] != getattr(self.settings, key):
                    raise RunError(f"{path}: was trained with {key}={state['settings'][key]}")
            self.network.load_state_dict(state["network"])
            self.average.load_state_dict(state["average"])
            self.optimizer.load_state_dict(state["optimizer"])
        except (OSError, RuntimeError, KeyError, EOFError) as error:
            reason = str(error).splitlines()[0]
            raise RunError(f"{path}: cannot be resumed ({reason}); remove it") from error
        self.epoch, self.seconds = state["epoch"], state["seconds"]


def train_detector(
    dataset: Path,
    out: Path,
    settings: Settings = Settings(),
    *,
    template: Path = BUILTINS[BUILTIN],
    resume: bool = False,
    log: Callable[[str], None] = print,
) -> dict:
    """Train the network of ``template`` on ``dataset`` and return the report on its test half.

    ``template`` is a Darknet ``.cfg``, or a folder with a ``config.json`` of transformers.  ``out``
    receives what :func:`cnca.detect.load_detector` understands: ``<template>.cfg`` (with anchors
    of the data), ``.names`` and ``.safetensors``, or the files of a transformers folder; the
    report, ``<template>.json``; and after each epoch ``checkpoint.pt``, from which ``resume``
    continues.

    Raises:
        DetectorError: the data set cannot be used.
        RunError: ``out`` holds a training already (without ``resume``), or one of other settings.
        NonFiniteError: the loss became NaN or infinite.
    """
    data = LabelledPictures(dataset)
    checkpoint = checkpoint_in(out, resume=resume)
    out.mkdir(parents=True, exist_ok=True)
    if not any(len(data.boxes[index]) for index in data.of_split(TRAIN)):
        raise DetectorError(f"{data.folder}: no boxes to train on")
    training = Training(start(data, template, out, settings), settings)
    if checkpoint.exists():
        training.load(checkpoint)
        log(f"resumed after epoch {training.epoch}")
    run_epochs(training, data, checkpoint, log)
    saved = training.subject.save(training.average.module)
    report = {
        "settings": asdict(settings),
        "epochs": training.epoch,
        "seconds": round(training.seconds, 1),
        "test": measure(load_detector(str(saved)), data),
    }
    write_text(out / f"{template.stem}.json", json.dumps(report, indent=2) + "\n")
    return report


def checkpoint_in(out: Path, *, resume: bool) -> Path:
    """The checkpoint of ``out``; raises RunError where there is one that is not to be resumed."""
    checkpoint = out / "checkpoint.pt"
    if checkpoint.exists() and not resume:
        raise RunError(f"{out}: already holds a training; add --resume or choose another --out")
    return checkpoint


def start(data: LabelledPictures, template: Path, out: Path, settings: Settings) -> Subject:
    """The network of ``template`` for the classes of ``data``, to be saved into ``out``."""
    kind: type[Subject] = DarknetSubject
    if template.suffix != ".cfg":
        from cnca.train.transformer_subject import TransformerSubject

        kind = TransformerSubject
    begin = kind.fine_tune if settings.fine_tune else kind.begin
    return begin(data, template, out, settings.seed)


def run_epochs(
    training: Training, data: LabelledPictures, checkpoint: Path, log: Callable[[str], None]
) -> None:
    """Train until the last epoch or the time limit, with a checkpoint after each epoch."""
    settings = training.settings
    pictures = TrainingPictures(data, training.subject.size, settings.seed)
    if len(pictures) < settings.batch:
        raise DetectorError(f"{data.folder}: {len(pictures)} pictures to train on, too few")
    with bar() as shown, torch.random.fork_rng(devices=[]):
        task = shown.add_task("training, percent", total=100)
        while training.progress(0.0, training.seconds) < 1:
            started, before = time.monotonic(), training.seconds
            pictures.epoch = training.epoch
            loader = _loader(pictures, settings)
            # What networks draw while they train depends on the epoch alone: resumed runs agree.
            torch.manual_seed(settings.seed * 1_000_003 + training.epoch)
            sums: dict[str, float] = {}
            for index, (images, targets) in enumerate(loader):
                training.seconds = before + time.monotonic() - started
                progress = training.progress(index / len(loader), training.seconds)
                losses = training.step(images, targets, progress)
                sums = {name: sums.get(name, 0.0) + value for name, value in losses.items()}
                shown.update(task, completed=round(100 * progress))
                if progress >= 1:
                    break
            training.epoch += 1
            training.seconds = before + time.monotonic() - started
            training.save(checkpoint)
            means = ", ".join(f"{name} {s / (index + 1):.3f}" for name, s in sums.items())
            log(f"epoch {training.epoch}: {means}, {training.seconds:.0f} s")


def rate_factor(progress: float) -> float:
    """Step size in [0, 1]: linear warm-up, half a cosine to zero (Loshchilov & Hutter 2017)."""
    if progress < WARM_UP:
        return max(progress / WARM_UP, 0.01)
    return 0.5 * (1 + math.cos(math.pi * (progress - WARM_UP) / (1 - WARM_UP)))


def moving_average(averaged: Tensors, current: Tensors, steps: torch.Tensor | int) -> None:
    """Exponential moving average in place; it forgets faster during the first steps."""
    decay = min(AVERAGING, (1 + int(steps)) / (10 + int(steps)))
    get_ema_multi_avg_fn(decay)(averaged, current, steps)


def _loader(pictures: TrainingPictures, settings: Settings) -> DataLoader:
    """Batches in random order, made in this process: one forked from it may wait for ever for the
    locks of threads that it does not have, such as the renderer's.
    """
    order = torch.Generator().manual_seed(settings.seed * 1_000_003 + pictures.epoch)
    return DataLoader(
        pictures,
        settings.batch,
        shuffle=True,
        drop_last=True,
        generator=order,
        collate_fn=collate,
    )
