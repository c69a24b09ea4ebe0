"""Training of a detector: augmented pictures, the losses of its heads, AP@0.5 by group."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import torch
from torch import Tensor

from cnca.core.errors import DetectorError, RunError
from cnca.core.manifest import write_json
from cnca.core.records import as_json
from cnca.detect import BUILTIN, BUILTINS, load_detector
from cnca.train.detector.accuracy import measure
from cnca.train.detector.dataset import TRAIN, LabelledPictures, TrainingPictures, collate
from cnca.train.detector.trainable import TrainableDetector
from cnca.train.detector.yolo_loss import Targets
from cnca.train.loop import TrainingLoop
from cnca.train.task import Recipe, Task

WARM_UP, WEIGHT_DECAY, AVERAGING = 0.05, 0.02, 0.998
"""Share of the steps in which the step size grows; the others as in :class:`Recipe`."""
LARGEST_GRADIENT = 10.0
FINE_TUNING = 0.25
"""Step size of fine-tuning relative to that of a training from scratch."""


def fast_in_bfloat16() -> bool:
    """Whether this processor multiplies matrices in bfloat16 itself."""
    return bool(torch.cpu.get_capabilities().get("amx_bf16", False))


@dataclass(frozen=True)
class Settings:
    """What decides the outcome of a training, apart from the data."""

    epochs: int = 20
    batch: int = 32
    seed: int = 0
    bfloat16: bool = field(default_factory=fast_in_bfloat16)
    """Convolve in bfloat16: several times faster on processors with AMX, slower on others."""
    fine_tune: bool = False
    """Begin with the template's own weights and anchors, and take smaller steps."""
    loud_patches: bool = False
    """Lay patches of loud texture over the pictures (:mod:`cnca.train.detector.cover`)."""

    def __post_init__(self) -> None:
        if self.epochs < 1:
            raise RunError(f"--epochs {self.epochs}: a training needs at least one")


@dataclass(frozen=True)
class DetectorReport:
    """The result of a training."""

    settings: Settings
    test: dict[str, dict[str, float]]
    """Group of test pictures → measure → value, as :func:`measure` says."""


class DetectorTask(Task[tuple[Tensor, Targets]]):
    """A detector that learns from the training half of a data set, epoch by epoch."""

    name = "detector"

    def __init__(
        self, detector: TrainableDetector, data: LabelledPictures, settings: Settings
    ) -> None:
        """Raises DetectorError where there is less than one batch of pictures."""
        self.detector, self.network = detector, detector.network
        self.network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._pictures = TrainingPictures(
            data,
            detector.size,
            settings.seed,
            classes=detector.classes,
            loud_patches=settings.loud_patches,
        )
        if len(self._pictures) < settings.batch:
            raise DetectorError(
                f"{data.folders[0]}: {len(self._pictures)} pictures to train on, too few"
            )
        self._epoch = len(self._pictures) // settings.batch
        self._batch, self._seed, self._bfloat16 = settings.batch, settings.seed, settings.bfloat16
        self.settings = {
            "batch": settings.batch,
            "bfloat16": settings.bfloat16,
            "loud_patches": settings.loud_patches,
        }
        steps = settings.epochs * self._epoch
        self.recipe = Recipe(
            steps,
            detector.learning_rate * (FINE_TUNING if settings.fine_tune else 1.0),
            save_every=self._epoch,
            warm_up=max(1, round(WARM_UP * steps)),
            last_rate=0.0,
            weight_decay=WEIGHT_DECAY,
            largest_gradient=LARGEST_GRADIENT,
            averaging=AVERAGING,
        )

    def batch(self, step: int, rng: torch.Generator) -> tuple[Tensor, Targets]:
        """Pictures in an order, and augmented in a way, that seed and epoch say."""
        epoch, index = divmod(step, self._epoch)
        order_rng = torch.Generator().manual_seed(self._seed * 1_000_003 + epoch)
        order = torch.randperm(len(self._pictures), generator=order_rng).tolist()
        chosen = order[index * self._batch : (index + 1) * self._batch]
        self._pictures.epoch = epoch
        images, targets = collate([self._pictures[item] for item in chosen])
        return images.contiguous(memory_format=torch.channels_last), targets

    def losses(self, batch: tuple[Tensor, Targets], rng: torch.Generator) -> dict[str, Tensor]:
        """The losses of the detector's heads."""
        return self.detector.losses(*batch, bfloat16=self._bfloat16)

    def where(self, step: int) -> str:
        """Counted in epochs, the first one 1."""
        return f"epoch {step // self._epoch + 1}, batch {step % self._epoch + 1}"


def train_detector(
    datasets: Path | Sequence[Path],
    out: Path,
    settings: Settings | None = None,
    *,
    template: Path = BUILTINS[BUILTIN],
    resume: bool = False,
) -> DetectorReport:
    """Train the network of ``template`` on data sets and return the report on their test halves.

    ``template`` is a Darknet ``.cfg``, or a folder with a ``config.json`` of transformers.  ``out``
    receives what :func:`cnca.detect.load_detector` understands: ``<template>.cfg`` (with anchors
    of the data), ``.names`` and ``.safetensors``, or the files of a transformers folder; the
    report, ``<template>.json``; and after each epoch ``detector.pt``, from which ``resume``
    continues.

    Raises:
        DetectorError: the data set cannot be used.
        RunError: ``out`` holds a training already (without ``resume``), or one of other settings.
        NonFiniteError: a loss or gradient became NaN or infinite.
    """
    settings = settings or Settings()
    data = LabelledPictures(*([datasets] if isinstance(datasets, Path) else datasets))
    loop = TrainingLoop(out, settings.seed, resume)
    out.mkdir(parents=True, exist_ok=True)
    if not any(len(data.boxes[index]) for index in data.of_split(TRAIN)):
        raise DetectorError(f"{data.folders[0]}: no boxes to train on")
    detector = start(data, template, out, settings)
    saved = detector.save(loop.run(DetectorTask(detector, data, settings)))
    report = DetectorReport(settings, measure(load_detector(str(saved)), data))
    write_json(out / f"{template.stem}.json", as_json(report))
    return report


def start(
    data: LabelledPictures, template: Path, out: Path, settings: Settings
) -> TrainableDetector:
    """The network of ``template`` for the classes of ``data``, to be saved into ``out``."""
    from cnca.train.detector.darknet import TrainableDarknet

    kind: type[TrainableDetector] = TrainableDarknet
    if template.suffix != ".cfg":
        from cnca.train.detector.transformer import TrainableTransformer

        kind = TrainableTransformer
    begin = kind.fine_tune if settings.fine_tune else kind.begin
    return begin(data, template, out, settings.seed)
