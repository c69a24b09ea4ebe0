"""Training of RT-DETR (Zhao et al. 2024) by transformers' own classes.

The decoder learns by bipartite matching and denoising, as the library has it.  There a single query
answers for an object, which teaches the encoder little per picture: its proposals learn as an
anchor-free head does instead, many cells for an object (as in Co-DETR, Zong et al. 2023).
"""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import torch
from torch import Tensor, nn

from cnca.core.boxes import cxcywh_to_xyxy, xyxy_to_cxcywh
from cnca.core.files import replacing, write_text
from cnca.detect.transformer import load_model
from cnca.train.detector.anchor_free_loss import aligned_loss, cell_places
from cnca.train.detector.dataset import LabelledPictures
from cnca.train.detector.trainable import TrainableDetector, autocast
from cnca.train.detector.yolo_loss import Targets

CONFIG, PREPARATION, WEIGHTS = "config.json", "preprocessor_config.json", "model.safetensors"
USUAL_SIZE = 2.0
"""Logit by which boxes are larger than the library's anchors, of 5 and 10 % of the picture."""


class TrainableTransformer(TrainableDetector):
    """The network of a folder with ``config.json`` and ``preprocessor_config.json``."""

    learning_rate = 1e-3

    def __init__(
        self, template: Path, out: Path, seed: int, class_names: list[str] | None = None
    ) -> None:
        """Draw weights; the classes of ``template`` give way to ``class_names``, if there are."""
        from transformers import AutoConfig, AutoModelForObjectDetection

        names = {"id2label": dict(enumerate(class_names))} if class_names else {}
        config = AutoConfig.from_pretrained(template, local_files_only=True, **names)
        self.classes = config.num_labels
        with torch.random.fork_rng(devices=[]):  # the library draws from the global generator
            torch.manual_seed(seed)
            self.network = AutoModelForObjectDetection.from_config(config)
        begin_well(self.network)
        self.out = out
        self.preparation = (template / PREPARATION).read_text(encoding="utf-8")
        size = json.loads(self.preparation)["size"]
        self.size = (size["height"], size["width"])

    @classmethod
    def begin(
        cls, data: LabelledPictures, template: Path, out: Path, seed: int
    ) -> TrainableTransformer:
        """A new network of ``template`` for the classes of ``data``."""
        return cls(template, out, seed, data.class_names)

    @classmethod
    def fine_tune(
        cls,
        data: LabelledPictures,  # noqa: ARG003  (the protocol has it)
        template: Path,
        out: Path,
        seed: int,
    ) -> TrainableTransformer:
        """The network of ``template`` with its weights."""
        detector = cls(template, out, seed)
        detector.network.load_state_dict(load_model(template).state_dict())
        return detector

    def losses(self, images: Tensor, targets: Targets, *, bfloat16: bool) -> dict[str, Tensor]:
        """Losses of the decoder (``matched``) and of the encoder's proposals; the backbone may use
        bfloat16, which sampling at fractional places does not bear.
        """
        scale = targets.boxes.new_tensor(self.size[::-1] * 2)
        boxes = xyxy_to_cxcywh(targets.boxes) / scale
        labels = [
            {"class_labels": targets.labels[in_image], "boxes": boxes[in_image]}
            for in_image in (targets.images == image for image in range(len(images)))
        ]
        with backbone_in_bfloat16(self.network, images, bfloat16):
            outputs = self.network(pixel_values=images, labels=labels)
        config: Any = self.network.config
        proposals = f"_aux_{config.decoder_layers - 1}"  # after those of all layers but the last
        decoder = [v for name, v in outputs.loss_dict.items() if not name.endswith(proposals)]
        grids = [[side // stride for side in self.size] for stride in config.feat_strides]
        dense = aligned_loss(
            cxcywh_to_xyxy(outputs.enc_outputs_coord_logits.sigmoid()) * scale,
            outputs.enc_outputs_class,
            cell_places(grids, self.size),
            targets,
        )
        return {"matched": torch.stack(decoder).sum(), **dense}

    def save(self, network: nn.Module) -> Path:
        """Write configuration and weights, these in half precision, in the library's format."""
        from transformers.utils.logging import disable_progress_bar

        disable_progress_bar()
        half: Any = copy.deepcopy(cast(Any, network)).half()
        with replacing(self.out / WEIGHTS) as temporary:
            half.save_pretrained(temporary.parent)
        write_text(self.out / CONFIG, half.config.to_json_string())
        write_text(self.out / PREPARATION, self.preparation)
        return self.out


def begin_well(network: Any) -> None:
    """Let norms begin with a scale of 1, and proposals with boxes of usual size.

    The library draws the scale with a mean of 0 and a deviation of 0.01, as if it were a weight:
    several such layers let neither signal nor gradient through, and training takes long to mend it.
    """
    for layer in network.modules():
        if isinstance(layer, nn.BatchNorm2d):
            nn.init.ones_(layer.weight)
    nn.init.constant_(network.model.enc_bbox_head.layers[-1].bias[2:], USUAL_SIZE)


@contextmanager
def backbone_in_bfloat16(network: Any, images: Tensor, enabled: bool) -> Iterator[None]:
    """Let the backbone, and nothing else, compute in bfloat16."""
    backbone = network.model.backbone
    forward = backbone.forward

    def forward_in_bfloat16(*inputs: Tensor) -> list[tuple[Tensor, Tensor]]:
        with autocast(images, enabled):
            features = forward(*inputs)
        return [(feature.float(), mask) for feature, mask in features]

    backbone.forward = forward_in_bfloat16
    try:
        yield
    finally:
        del backbone.forward
