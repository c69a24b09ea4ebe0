"""Darknet networks as detectors with a gradient."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch

from cnca.core.errors import DetectorError, did_you_mean
from cnca.core.types import Candidates, SrgbImages
from cnca.detect.base import CandidateDetector
from cnca.detect.cfg import Config, parse_config, read_config
from cnca.detect.classes import COCO, read_names
from cnca.detect.darknet import Darknet
from cnca.detect.preprocess import letterbox, stretch
from cnca.detect.weights import SUFFIXES, load_weights
from cnca.detect.yolov3 import CONFIGS


class DarknetDetector(CandidateDetector):
    """A network with ``[yolo]`` heads, in evaluation mode with frozen weights.

    Pictures are stretched to the network's input, as Bochkovskiy's Darknet does, with which
    YOLOv4 and YOLO-Fastest were trained; ``letter_box=1`` in ``[net]`` (his key) keeps the aspect
    ratio instead and fills with grey 0.5, as Redmon's Darknet does.
    """

    differentiable = True

    def __init__(self, network: Darknet, class_names: Sequence[str], name: str) -> None:
        self.network = network.eval().requires_grad_(False)
        self.class_names = tuple(class_names)
        self.name = name
        self.size = network.config.size
        self.keeps_aspect = bool(network.config.net.integer("letter_box", 0))

    @classmethod
    def load(
        cls, config: Path, *, device: torch.device | str = "cpu", name: str | None = None
    ) -> DarknetDetector:
        """Read ``config`` and the weights of its stem; names too, where classes are not COCO's.

        Raises:
            DetectorError: a file is missing or cannot be used.
        """
        return cls._of(read_config(config), _beside(config), device, name or config.stem)

    @classmethod
    def load_weights(cls, weights: Path, *, device: torch.device | str = "cpu") -> DarknetDetector:
        """Read ``weights`` for the configuration of the same stem beside it, or for our own YOLOv3.

        Raises:
            DetectorError: there is neither, or a file cannot be used.
        """
        config = weights.with_suffix(".cfg")
        if config.is_file():
            return cls._of(read_config(config), weights, device, weights.stem)
        if weights.stem not in CONFIGS:
            hint = did_you_mean(weights.stem, CONFIGS)
            raise DetectorError(f"{weights}: no {config.name} beside it; put it there{hint}")
        parsed = parse_config(CONFIGS[weights.stem](), config)
        return cls._of(parsed, weights, device, weights.stem)

    @classmethod
    def _of(
        cls, config: Config, weights: Path, device: torch.device | str, name: str
    ) -> DarknetDetector:
        network = Darknet(config)
        load_weights(network, weights)
        names = _class_names(config.path, network.heads[0].classes)
        return cls(network.to(device), names, name)

    def candidates(self, images: SrgbImages) -> Candidates:
        """Return all boxes of all heads, in pixels of ``images``; differentiable in ``images``.

        Images of another type or device are brought to the network's, where the results stay.
        """
        images = SrgbImages(images.to(next(self.network.parameters())))
        if self.keeps_aspect:
            inputs, placement = letterbox(images, self.size, 0.5, centred=True)
        else:
            inputs, placement = stretch(images, self.size)
        raw = self.network(inputs)
        parts = [
            head.candidates(values, self.size)
            for head, values in zip(self.network.heads, raw, strict=True)
        ]
        return Candidates(
            boxes=placement.back(torch.cat([part.boxes for part in parts], dim=1)),
            objectness=torch.cat([part.objectness for part in parts], dim=1),
            class_scores=torch.cat([part.class_scores for part in parts], dim=1),
        )


def _beside(config: Path) -> Path:
    """The weights of the same stem."""
    for suffix in SUFFIXES:
        if (path := config.with_suffix(suffix)).is_file():
            return path
    expected = " or ".join(config.with_suffix(suffix).name for suffix in SUFFIXES)
    raise DetectorError(f"{config}: no weights beside it; put {expected} into the same folder")


def _class_names(config: Path, classes: int) -> Sequence[str]:
    """One name per line in the ``.names`` file of the same stem, or COCO's 80."""
    path = config.with_suffix(".names")
    if not path.is_file():
        if classes == len(COCO):
            return COCO
        raise DetectorError(f"{config}: write the names of its {classes} classes to {path.name}")
    names = read_names(path)
    if len(names) != classes:
        raise DetectorError(f"{path}: {len(names)} names for {classes} classes of {config.name}")
    return names
