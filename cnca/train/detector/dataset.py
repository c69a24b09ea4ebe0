"""Pictures with boxes from a folder, for training and testing detectors."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor
from torch.utils.data import Dataset

from cnca.core.errors import DetectorError
from cnca.train.detector.augment import augment
from cnca.train.detector.yolo_loss import Targets

TRAIN, TEST = "train", "test"
KEYS = ("class_names", "boxes", "group", "split")


class LabelledPictures:
    """One or more folders of ``images.npy`` and ``labels.json``, joined.

    ``images.npy`` is uint8 sRGB (count, height, width, 3) and is read piece by piece; sizes may
    differ from folder to folder.  ``labels.json`` holds ``class_names``, the same in all folders;
    ``boxes``, for each picture a list of [left, top, right, bottom, class] in pixels; ``group``,
    for each picture the name under which it is reported; ``split``, for each picture ``train`` or
    ``test``.

    Raises:
        DetectorError: a file is missing, or its content does not fit.
    """

    def __init__(self, *folders: Path) -> None:
        self.folders = folders
        self.pictures: list[UInt8[np.ndarray, "_ _ 3"]] = []
        self.class_names: list[str] = []
        self.groups: list[str] = []
        self.boxes: list[Float[np.ndarray, "_ 5"]] = []
        self.split: list[str] = []
        for folder in folders:
            self._add(folder)

    def of_split(self, split: str) -> list[int]:
        """Indices of the pictures in ``train`` or ``test``."""
        return [index for index, name in enumerate(self.split) if name == split]

    def _add(self, folder: Path) -> None:
        try:
            pictures = np.load(folder / "images.npy", mmap_mode="r")
            labels = json.loads((folder / "labels.json").read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise DetectorError(f"{folder}: no data set for a detector ({error})") from error
        for key in KEYS:
            if key not in labels:
                raise DetectorError(f"{folder / 'labels.json'}: key '{key}' is missing")
        _check_pictures(folder, pictures)
        for key in ("boxes", "group", "split"):
            if len(labels[key]) != len(pictures):
                raise DetectorError(
                    f"{folder / 'labels.json'}: '{key}' has {len(labels[key])} entries, "
                    f"images.npy holds {len(pictures)} pictures"
                )
        names = labels["class_names"]
        if self.class_names and names != self.class_names:
            others = f"those of {self.folders[0]} {self.class_names}"
            raise DetectorError(f"{folder / 'labels.json'}: class_names are {names}, {others}")
        boxes = [np.array(b, float).reshape(-1, 5) for b in labels["boxes"]]
        _check_boxes(folder, pictures, boxes, len(names))
        self.class_names = names
        self.pictures += list(pictures)
        self.boxes += boxes
        self.groups += labels["group"]
        self.split += labels["split"]


def _check_pictures(folder: Path, pictures: np.ndarray) -> None:
    shape, dtype = pictures.shape, pictures.dtype
    if len(shape) != 4 or shape[3] != 3 or dtype != np.uint8:
        problem = f"is {dtype} {shape}, must be uint8 (count, height, width, 3)"
        raise DetectorError(f"{folder / 'images.npy'}: {problem}")


def _check_boxes(
    folder: Path, pictures: np.ndarray, labels: list[np.ndarray], classes: int
) -> None:
    height, width = pictures.shape[1:3]
    for index, boxes in enumerate(labels):
        low, high, label = boxes[:, :2], boxes[:, 2:4], boxes[:, 4]
        inside = (low >= 0).all() and (high <= [width, height]).all() and (low < high).all()
        if not inside or not np.isin(label, np.arange(classes)).all():
            where = f"{folder / 'labels.json'}: boxes of picture {index}"
            raise DetectorError(f"{where} must lie in {width}×{height} px, with a known class")


class TrainingPictures(Dataset[Any]):
    """Augmented pictures of the training half; the same seed and epoch give the same pictures."""

    def __init__(
        self,
        data: LabelledPictures,
        size: tuple[int, int],
        seed: int,
        *,
        classes: int,
        loud_patches: bool = False,
    ) -> None:
        """Of the data's classes only the first ``classes`` are to be found."""
        self.data, self.size, self.seed = data, size, seed
        self.classes, self.loud_patches = classes, loud_patches
        self.indices = data.of_split(TRAIN)
        self.epoch = 0

    def __len__(self) -> int:
        return len(self.indices)

    def __getitem__(self, item: int) -> tuple[UInt8[np.ndarray, "height width 3"], np.ndarray]:
        """A picture and its boxes (objects, 5), the class last."""
        index = self.indices[item]
        picture, labels = augment(
            np.asarray(self.data.pictures[index]),
            self.data.boxes[index],
            self.size,
            np.random.default_rng((self.seed, self.epoch, index)),
            loud_patches=self.loud_patches,
        )
        return picture, labels[labels[:, 4] < self.classes]


def collate(
    samples: list[tuple[np.ndarray, np.ndarray]],
) -> tuple[Float[Tensor, "batch 3 height width"], Targets]:
    """One batch: sRGB pictures in [0, 1] and all their objects."""
    pictures = torch.from_numpy(np.stack([picture for picture, _ in samples]))
    boxes = torch.from_numpy(np.concatenate([labels for _, labels in samples])).float()
    images = [image for image, (_, labels) in enumerate(samples) for _ in labels]
    targets = Targets(boxes[:, :4], boxes[:, 4].long(), torch.tensor(images, dtype=torch.long))
    return pictures.permute(0, 3, 1, 2).float() / 255, targets
