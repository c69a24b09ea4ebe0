"""What ``cnca train-detector`` does: a built-in detector from renders and labelled frames."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from cnca.core.errors import DetectorError, did_you_mean
from cnca.core.manifest import hashes
from cnca.core.run_folder import RunFolder
from cnca.detect import TRAINED
from cnca.train.detector.frames import gather_frames
from cnca.train.detector.renders import render_detector_data
from cnca.train.detector.request import DetectorRequest
from cnca.train.detector.street_renders import render_streets
from cnca.train.detector.training import DetectorReport, Settings, train_detector
from cnca.train.loop import TrainingLoop

STREET_REPEATS = 2
"""How often an epoch shows each picture of a street; they are few, since they are expensive."""


def train_builtin(request: DetectorRequest, *, resume: bool) -> DetectorReport:
    """Render and gather pictures, train into ``out/KIND``, return the report on the test halves.

    Raises:
        DetectorError: there is no such ``kind``, or nothing to learn from.
        RunError: ``out/KIND`` holds a training already (without ``resume``).
    """
    if request.kind not in TRAINED:
        hint = did_you_mean(request.kind, TRAINED)
        known = ", ".join(TRAINED)
        raise DetectorError(f"kind '{request.kind}': unknown; there is {known}{hint}")
    if request.held_out and request.frames is None:
        raise DetectorError("--held-out: names frames; give --frames, too")
    out, template = request.out / request.kind, TRAINED[request.kind]
    settings = Settings(
        request.epochs,
        request.batch,
        request.seed,
        fine_tune=request.fine_tune,
        loud_patches=True,
    )
    TrainingLoop(out, request.seed, resume)  # refuses before anything is rendered
    of_folder = template / "config.json", template / "model.safetensors"
    of_file = template, template.with_suffix(".safetensors")
    configuration, weights = of_file if template.is_file() else of_folder
    inputs = [configuration, weights] if request.fine_tune else [configuration]
    if request.frames is not None:
        inputs += sorted(file for file in request.frames.glob("*/*") if file.is_file())
    asked = {key: value for key, value in asdict(request).items() if key != "out"}
    asked |= {"frames": request.frames and str(request.frames), "held_out": [*request.held_out]}
    RunFolder(out, "train-detector").claim(asked, hashes(inputs), resume=resume)
    datasets = _datasets(request)
    return train_detector(datasets, out, settings, template=template, resume=resume)


def _datasets(request: DetectorRequest) -> list[Path]:
    datasets = []
    if request.frames is not None:
        datasets.append(request.out / "frames")
        gather_frames(request.frames, datasets[-1], held_out=request.held_out)
    if request.pictures:
        datasets.append(request.out / "pictures")
        render_detector_data(datasets[-1], pictures=request.pictures, seed=request.seed)
    if request.streets:
        folder = request.out / "streets"
        render_streets(folder, pictures=request.streets, seed=request.seed)
        datasets += [folder] * STREET_REPEATS
    if not datasets:
        raise DetectorError("--pictures 0 --streets 0: give at least one, or --frames")
    return datasets
