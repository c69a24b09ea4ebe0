"""What a run's camouflage is worth once it is printed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import torch
from jaxtyping import Float
from pydantic import Field
from rich.console import Console
from torch import Tensor

from cnca import build
from cnca.core.errors import RunError
from cnca.core.progress import bar
from cnca.core.records import read_record
from cnca.core.types import SrgbTexture
from cnca.judge.bootstrap import Sampled, resample
from cnca.judge.evaluate import Result, evaluate
from cnca.judge.held_out import held_out_shots
from cnca.judge.records import Estimate
from cnca.scene.load_scene import load_scene
from cnca.scene.paint import Paint
from cnca.scene.schema import Scene
from cnca.vehicle.model import Vehicle

RUN_FILES = ("manifest.json", "summary.json", "texture.png")
"""What is read of a finished run."""


@dataclass(frozen=True)
class Seeded:
    """What is read of a run's settings."""

    seed: int


@dataclass(frozen=True)
class Asked:
    """What is read of a run's request."""

    scene: Path
    backend: str
    held_out_views: int
    settings: Seeded
    detectors: Sequence[str] = ()
    detector: str | None = None
    """Of runs of the first versions, which have one."""


@dataclass(frozen=True)
class RunManifest:
    """What is read of a run's manifest."""

    request: Asked


@dataclass(frozen=True)
class Run:
    """A finished ``cnca optimize``, as its folder tells."""

    folder: Path
    scene: Scene
    vehicle: Vehicle
    paint: Paint
    request: Asked

    @property
    def texture(self) -> SrgbTexture:
        """The camouflage at the size in which it is rendered."""
        return self.paint.resize(build.read_texture(self.folder / "texture.png"))


def read_run(folder: Path) -> Run:
    """The run in a folder; raises RunError where none is, or where it has not finished."""
    for name in RUN_FILES:
        file = folder / name
        if not file.is_file():
            raise RunError(f"{file}: not there; print-sheets takes the folder of a finished run")
    request = read_record(RunManifest, folder / "manifest.json").request
    scene = load_scene(request.scene)
    vehicle = build.build_vehicle(scene)
    return Run(folder, scene, vehicle, build.build_paint(scene, vehicle), request)


@dataclass(frozen=True)
class InPrint:
    """One detector's verdict on the plain paint, the texture and its print.

    95 % intervals are bootstrapped over the views.
    """

    score: Mapping[str, Estimate]
    """``plain``, ``texture`` and ``print`` → mean detection score."""
    average_precision: Annotated[Mapping[str, float], Field(alias="AP@0.5")]
    difference: Estimate
    """Score of the print less that of the texture."""
    lost: Estimate
    """Share of the score's fall from plain paint to camouflage that printing takes away; undefined
    where it does not fall."""


@dataclass(frozen=True)
class Prediction:
    """What a camouflage is worth in print, before each detector of its run."""

    views: int
    detectors: Mapping[str, InPrint]


def predict(run: Run, printed: SrgbTexture, console: Console) -> Prediction:
    """The run's verdict once more, for its texture and for what is left of it in print."""
    request, seed = run.request, run.request.settings.seed
    detectors = request.detectors or [request.detector or "builtin"]
    targets = build.build_targets(detectors, run.scene.vehicle.label)
    shots = held_out_shots(run.scene, request.held_out_views, seed)
    renderer = build.build_renderer(run.scene, run.vehicle, backend=request.backend)
    albedos = {
        "plain": run.paint.apply(),
        "texture": run.paint.apply(run.texture),
        "print": run.paint.apply(printed),
    }
    with bar(console) as shown:
        task = shown.add_task("held-out views", total=len(albedos) * len(shots.weathers))
        results = evaluate(renderer, targets, albedos, shots, lambda: shown.advance(task))
    weights = resample([request.held_out_views], seed=seed)
    return Prediction(
        views=request.held_out_views,
        detectors={name: _compared(result, weights) for name, result in results.items()},
    )


def _compared(results: Mapping[str, Result], weights: Float[Tensor, "samples views"]) -> InPrint:
    score = {
        name: Sampled(weights @ torch.tensor(result.scores).double() / len(result.scores))
        for name, result in results.items()
    }
    loss, fall = score["print"] - score["texture"], score["plain"] - score["texture"]
    share = loss.samples / fall.samples
    return InPrint(
        score={name: sampled.estimate() for name, sampled in score.items()},
        average_precision={name: round(r.average_precision, 4) for name, r in results.items()},
        difference=loss.estimate(),
        lost=Sampled(torch.where(fall.samples > 0, share, torch.nan)).estimate(),
    )
