"""Training of the detectors of transformers, with the library's own losses."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any, cast

import torch
from torch import Tensor, nn

from cnca.boxes import xyxy_to_cxcywh
from cnca.detect.dataset import LabelledPictures
from cnca.detect.subject import Subject
from cnca.detect.yolo_loss import Targets
from cnca.files import replacing, write_text

CONFIG, PREPARATION, WEIGHTS = "config.json", "preprocessor_config.json", "model.safetensors"


class TransformerSubject(Subject):
    """The network of a folder with ``config.json`` and ``preprocessor_config.json``."""

    learning_rate = 5e-4

    def __init__(self, template: Path, out: Path, class_names: list[str], seed: int) -> None:
        """Draw weights; the classes of ``template`` give way to ``class_names``."""
        from transformers import AutoConfig, AutoModelForObjectDetection

        names = {"id2label": dict(enumerate(class_names))}
        config = AutoConfig.from_pretrained(template, local_files_only=True, **names)
        with torch.random.fork_rng(devices=[]):  # the library draws from the global generator
            torch.manual_seed(seed)
            self.network = AutoModelForObjectDetection.from_config(config)
        self.out = out
        self.preparation = (template / PREPARATION).read_text(encoding="utf-8")
        size = json.loads(self.preparation)["size"]
        self.size = (size["height"], size["width"])

    @classmethod
    def begin(
        cls, data: LabelledPictures, template: Path, out: Path, seed: int
    ) -> TransformerSubject:
        """A new network of ``template`` for the classes of ``data``."""
        return cls(template, out, data.class_names, seed)

    def losses(self, images: Tensor, targets: Targets, *, bfloat16: bool) -> dict[str, Tensor]:
        """The loss after bipartite matching (Carion et al. 2020), in single precision throughout.

        Sampling at fractional places does not bear bfloat16.
        """
        height, width = self.size
        boxes = xyxy_to_cxcywh(targets.boxes) / targets.boxes.new_tensor((width, height) * 2)
        labels = [
            {"class_labels": targets.labels[own], "boxes": boxes[own]}
            for own in (targets.images == image for image in range(len(images)))
        ]
        return {"matched": self.network(pixel_values=images, labels=labels).loss}

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
