"""Labelled pictures rendered scene by scene: one file for each scene, joined into a data set."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from cnca.core.files import replacing
from cnca.train.detector.dataset import TEST, TRAIN
from cnca.train.detector.obstacles import CLASSES

TEST_SHARE = 0.15
"""Share of the scenes, the first ones, that are for testing."""


@dataclass(frozen=True)
class Picture:
    """One picture and what is to be found in it."""

    image: UInt8[np.ndarray, "height width 3"]
    """sRGB."""
    boxes: list[list[float]]
    """left, top, right, bottom in pixels, and the class."""
    group: str
    """Under which it is reported."""


def save_part(path: Path, pictures: Sequence[Picture]) -> None:
    """Write the pictures of one scene, all of one size."""
    labels = json.dumps([{"boxes": p.boxes, "group": p.group} for p in pictures])
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(file, images=np.stack([p.image for p in pictures]), labels=labels)


def join(out: Path, parts: Sequence[Path], *, test_share: float = TEST_SHARE) -> None:
    """Join scenes into the data set that :class:`LabelledPictures` reads."""
    images: list[np.ndarray] = []
    table: dict[str, list[object]] = {
        "class_names": [*CLASSES],
        "boxes": [],
        "group": [],
        "split": [],
    }
    for index, part in enumerate(parts):
        with np.load(part) as scene:
            pictures, labels = scene["images"], json.loads(str(scene["labels"]))
        split = TEST if index < test_share * len(parts) else TRAIN
        for picture, label in zip(pictures, labels, strict=True):
            images.append(picture)
            table["boxes"].append(label["boxes"])
            table["group"].append(label["group"])
            table["split"].append(split)
    with replacing(out / "images.npy") as temporary, temporary.open("wb") as file:
        np.save(file, np.stack(images))
    with replacing(out / "labels.json") as temporary:
        temporary.write_text(json.dumps(table))
