"""Pictures and YOLO labels of others as a data set to train detectors on."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cnca.core.errors import DetectorError
from cnca.core.files import replacing
from cnca.core.images import read_texture_srgb
from cnca.train.detector.dataset import TEST, TRAIN
from cnca.train.detector.obstacles import CAR, CLASSES

VEHICLE = 0
"""The label in the files that becomes class ``car``; the others are no targets."""


def gather_frames(folder: Path, out: Path, *, held_out: Sequence[str] = ()) -> None:
    """Write ``images.npy`` and ``labels.json`` into ``out``.

    Args:
        folder: ``images/*.jpg`` or ``.png``, all of one size, and ``labels/*.txt`` of the same
            stems (class, then middle, width and height as parts of the picture).
        out: the data set; a group is what stands before the first ``_`` of a file's name.
        held_out: groups for testing alone; the others are for training.

    Raises:
        DetectorError: there are no frames, no such group, or a label cannot be read.
    """
    files = sorted(p for p in (folder / "images").glob("*") if p.suffix in (".jpg", ".png"))
    if not files:
        raise DetectorError(f"{folder / 'images'}: no .jpg or .png; give a folder of frames")
    groups = [file.stem.split("_")[0] for file in files]
    for name in held_out:
        if name not in groups:
            known = ", ".join(sorted(set(groups)))
            raise DetectorError(f"--held-out {name}: no frame is named so; there are {known}")
    pictures = [(read_texture_srgb(file) * 255).round().astype(np.uint8) for file in files]
    if len({picture.shape for picture in pictures}) > 1:
        raise DetectorError(f"{folder / 'images'}: frames of several sizes; give them one size")
    boxes = [
        _boxes(folder / "labels" / f"{file.stem}.txt", picture)
        for file, picture in zip(files, pictures, strict=True)
    ]
    table = {
        "class_names": [*CLASSES],
        "boxes": boxes,
        "group": groups,
        "split": [TEST if group in held_out else TRAIN for group in groups],
    }
    out.mkdir(parents=True, exist_ok=True)
    with replacing(out / "images.npy") as temporary, temporary.open("wb") as file:
        np.save(file, np.stack(pictures))
    with replacing(out / "labels.json") as temporary:
        temporary.write_text(json.dumps(table))


def _boxes(path: Path, picture: np.ndarray) -> list[list[float]]:
    """left, top, right, bottom in pixels and class of every vehicle."""
    height, width = picture.shape[:2]
    boxes = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        try:
            label, *values = map(float, line.split())
            x, y, w, h = values
        except ValueError:
            problem = f"line {number}: give class, x, y, width, height"
            raise DetectorError(f"{path}: {problem}") from None
        if label == VEHICLE:
            low = np.array([(x - w / 2) * width, (y - h / 2) * height]).clip(0)
            high = np.minimum([(x + w / 2) * width, (y + h / 2) * height], [width, height])
            if (high > low).all():
                boxes.append([*low.tolist(), *high.tolist(), CAR])
    return boxes
