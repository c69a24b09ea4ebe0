"""Training of Darknet networks with anchor-based or anchor-free heads."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

import torch
from torch import Tensor, nn

from cnca.core.errors import DetectorError
from cnca.core.files import write_text
from cnca.detect.anchor_free import AnchorFreeHead
from cnca.detect.cfg import read_config
from cnca.detect.darknet import Convolution, Darknet, Head
from cnca.detect.weights import load_weights, save_weights
from cnca.detect.yolo import YoloHead
from cnca.train.detector.anchor_free_loss import anchor_free_loss
from cnca.train.detector.anchors import cluster_anchors, write_anchors
from cnca.train.detector.dataset import TRAIN, LabelledPictures
from cnca.train.detector.trainable import TrainableDetector, autocast
from cnca.train.detector.yolo_loss import Targets, yolo_loss

OBJECT_PRIOR = 0.01
"""Score that an untrained network gives everywhere (Lin et al. 2017, section 4.1)."""
LOSSES: dict[type, Callable[..., dict[str, Tensor]]] = {
    YoloHead: yolo_loss,
    AnchorFreeHead: anchor_free_loss,
}


class TrainableDarknet(TrainableDetector):
    """The network of a ``.cfg``."""

    learning_rate = 2e-3

    def __init__(self, config: Path, seed: int) -> None:
        self.config = config
        network = Darknet(read_config(config), torch.Generator().manual_seed(seed))
        set_object_prior(network)
        self.network, self.heads, self.size = network, network.heads, network.config.size
        self.classes = network.heads[0].classes

    @classmethod
    def begin(
        cls, data: LabelledPictures, template: Path, out: Path, seed: int
    ) -> TrainableDarknet:
        """Copy ``template`` into ``out``, with anchors of the data, and draw weights.

        A configuration that ``out`` has already is kept.
        """
        config = out / template.name
        if not config.exists():
            write_config(data, template, config, seed)
        return cls(config, seed)

    @classmethod
    def fine_tune(
        cls,
        data: LabelledPictures,  # noqa: ARG003  (the protocol has it)
        template: Path,
        out: Path,
        seed: int,
    ) -> TrainableDarknet:
        """Copy ``template`` into ``out`` as it is, and read the weights beside it."""
        for suffix in (".cfg", ".names"):
            text = template.with_suffix(suffix).read_text(encoding="utf-8")
            write_text(out / f"{template.stem}{suffix}", text)
        detector = cls(out / template.name, seed)
        load_weights(cast(Darknet, detector.network), template.with_suffix(".safetensors"))
        return detector

    def losses(self, images: Tensor, targets: Targets, *, bfloat16: bool) -> dict[str, Tensor]:
        """The losses of the heads; the convolutions may use bfloat16."""
        with autocast(images, bfloat16):
            raw = self.network(images)
        loss = LOSSES[type(self.heads[0])]
        return loss(self.heads, [r.float() for r in raw], targets, self.size)

    def save(self, network: nn.Module) -> Path:
        """Write the weights beside the configuration."""
        save_weights(cast(Darknet, network), self.config.with_suffix(".safetensors"))
        return self.config


def set_object_prior(network: Darknet) -> None:
    """Start with few objects everywhere, so that the background does not rule the first steps."""
    for before, head in pairwise(network.layers):
        if isinstance(head, Head) and isinstance(before, Convolution):
            bias: Any = before.convolution.bias
            if bias is not None:
                head.start(bias.data, OBJECT_PRIOR)


def write_config(data: LabelledPictures, template: Path, config: Path, seed: int) -> None:
    """Copy ``template`` with anchors of the training boxes, and write the class names beside it."""
    parsed = read_config(template)
    heads = Darknet(parsed).heads
    if heads[0].classes != len(data.class_names):
        names = ", ".join(data.class_names)
        raise DetectorError(f"{template}: {heads[0].classes} classes, the data set has: {names}")
    text = template.read_text(encoding="utf-8")
    count = sum(len(head.anchors) for head in heads if isinstance(head, YoloHead))
    if count:
        rng = torch.Generator().manual_seed(seed)
        text = write_anchors(text, cluster_anchors(_sizes(data, parsed.size), count, rng))
    write_text(config, text)
    write_text(config.with_suffix(".names"), "\n".join(data.class_names) + "\n")


def _sizes(data: LabelledPictures, size: tuple[int, int]) -> Tensor:
    """Widths and heights of the training boxes in pixels of the network's input."""
    height, width = size
    sizes = []
    for index in data.of_split(TRAIN):
        scale = min(height / data.pictures[index].shape[0], width / data.pictures[index].shape[1])
        boxes = torch.from_numpy(data.boxes[index]).float()
        sizes.append((boxes[:, 2:4] - boxes[:, :2]) * scale)
    return torch.cat(sizes)
