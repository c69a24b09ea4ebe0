"""What ``cnca train-detector`` does: a built-in detector from rendered pictures."""

from __future__ import annotations

from pathlib import Path

from cnca.core.errors import DetectorError, did_you_mean
from cnca.core.manifest import hashes
from cnca.core.run_folder import RunFolder
from cnca.detect import TRAINED
from cnca.train.detector.renders import render_detector_data
from cnca.train.detector.training import DetectorReport, Settings, train_detector
from cnca.train.loop import TrainingLoop


def train_builtin(
    out: Path, *, kind: str, pictures: int, epochs: int, seed: int, resume: bool
) -> DetectorReport:
    """Render the pictures into ``out/pictures``, train into ``out/KIND``, return the report.

    Raises:
        DetectorError: there is no such ``kind``.
        RunError: ``out/KIND`` holds a training already (without ``resume``).
    """
    if kind not in TRAINED:
        hint = did_you_mean(kind, TRAINED)
        raise DetectorError(f"kind '{kind}': unknown; there is {', '.join(TRAINED)}{hint}")
    settings = Settings(epochs=epochs, seed=seed)
    TrainingLoop(out / kind, seed, resume)  # refuses before anything is rendered
    asked = {"kind": kind, "pictures": pictures, "epochs": epochs, "seed": seed}
    template = TRAINED[kind]
    inputs = hashes([template if template.is_file() else template / "config.json"])
    RunFolder(out / kind, "train-detector").claim(asked, inputs, resume=resume)
    folder = out / "pictures"
    render_detector_data(folder, pictures=pictures, seed=seed)
    return train_detector(folder, out / kind, settings, template=template, resume=resume)
