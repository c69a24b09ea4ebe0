"""Object detectors of Hugging Face transformers, read from folders: white boxes.

DETR (Carion et al. 2020), Conditional DETR, Deformable DETR, YOLOS, RT-DETR, RT-DETRv2, D-FINE.
"""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from cnca.core.boxes import cxcywh_to_xyxy
from cnca.core.errors import DetectorError, did_you_mean
from cnca.core.text import read_text
from cnca.core.types import Candidates, SrgbImages
from cnca.detect.base import CandidateDetector
from cnca.detect.preprocess import IMAGENET, PLAIN, Entry

SOFTMAX = ("detr", "yolos")
"""Trained with one more class, no object, against which softmax weighs the others."""
FIXED_SIZE = ("rt_detr", "rt_detr_v2", "d_fine")
"""Trained on squares of 640 pixels with values in [0, 1]."""
KINDS = (*SOFTMAX, "conditional_detr", "deformable_detr", *FIXED_SIZE)
SHORTEST, LONGEST, SQUARE = 800, 1333, 640
"""Pixels per side where a folder says nothing."""


class TransformersDetector(CandidateDetector):
    """A network with ``logits`` and ``pred_boxes``, in evaluation mode with frozen weights.

    Pictures are resized and normalized as ``preprocessor_config.json`` says, and otherwise as is
    usual for the kind.
    """

    differentiable = True

    def __init__(self, model: nn.Module, name: str, preparation: dict[str, Any]) -> None:
        """``preparation`` is the content of ``preprocessor_config.json``."""
        self.model = model.eval().requires_grad_(False)
        self.name = name
        config: Any = model.config
        self.class_names = tuple(config.id2label[label] for label in range(config.num_labels))
        self.softmax = config.model_type in SOFTMAX
        self.fixed_size = config.model_type in FIXED_SIZE
        self.preparation = preparation
        self.entry = self._entry()

    @classmethod
    def load(
        cls, folder: Path, *, device: torch.device | str = "cpu", name: str | None = None
    ) -> TransformersDetector:
        """Read ``config.json`` and safetensors from ``folder``; nothing is fetched or executed.

        Raises:
            DetectorError: a file is missing or cannot be used, or needs a package that is missing.
        """
        config = _read_json(folder / "config.json")
        _check(folder, config)
        preparation = folder / "preprocessor_config.json"
        options = _read_json(preparation) if preparation.is_file() else {}
        return cls(load_model(folder).to(device), name or folder.resolve().name, options)

    def candidates(self, images: SrgbImages) -> Candidates:
        """Return one box per query in pixels of ``images``; differentiable in ``images``.

        Images of another type or device are brought to the network's, where the results stay.
        """
        images = SrgbImages(images.to(next(self.model.parameters())))
        height, width = size = self._size(images.shape[2], images.shape[3])
        inputs, placement = self.entry.prepare(images, size)
        found = self.model(pixel_values=inputs)
        boxes = cxcywh_to_xyxy(found.pred_boxes) * inputs.new_tensor((width, height) * 2)
        scores = self._scores(found.logits)
        return Candidates(placement.back(boxes), torch.ones_like(scores[..., 0]), scores)

    def _scores(self, logits: Tensor) -> Tensor:
        return logits.softmax(dim=-1)[..., :-1] if self.softmax else logits.sigmoid()

    def _entry(self) -> Entry:
        usual = PLAIN if self.fixed_size else IMAGENET
        if not self.preparation.get("do_normalize", not self.fixed_size):
            return PLAIN
        mean, std = (
            tuple(self.preparation.get(key) or default)
            for key, default in (("image_mean", IMAGENET.mean), ("image_std", IMAGENET.std))
        )
        return Entry(usual.channels, usual.white, mean, std)

    def _size(self, height: int, width: int) -> tuple[int, int]:
        """Height and width of the network's input for a picture."""
        usual = {"height": SQUARE, "width": SQUARE} if self.fixed_size else {}
        size = self.preparation.get("size") or usual
        if isinstance(size, int):  # as old folders have it
            size = {"shortest_edge": size, "longest_edge": self.preparation.get("max_size")}
        if not self.preparation.get("do_resize", True):
            return height, width
        if "height" in size:
            return size["height"], size["width"]
        low, high = sorted((height, width))
        longest = size.get("longest_edge") or LONGEST
        shorter = min(size.get("shortest_edge", SHORTEST), longest * low / high)
        sides = round(shorter), int(shorter * high / low)
        return sides if height <= width else sides[::-1]


def _read_json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(read_text(path, DetectorError))
    except (OSError, ValueError) as error:
        raise DetectorError(f"{path}: cannot be read as JSON ({error})") from error
    if not isinstance(content, dict):
        raise DetectorError(f"{path}: must be a JSON object")
    return content


def _check(folder: Path, config: dict[str, Any]) -> None:
    """Refuse what we cannot run, before transformers looks for it on the net."""
    where, kind = folder / "config.json", config.get("model_type")
    if kind not in KINDS:
        hint = did_you_mean(str(kind), KINDS)
        raise DetectorError(
            f"{where}: model_type '{kind}' is not supported; there is {', '.join(KINDS)}{hint}"
        )
    if not list(folder.glob("*.safetensors")):
        raise DetectorError(f"{folder}: no *.safetensors; save the model again in that format")
    backbone = config.get("backbone_config")
    by_name = backbone is None and kind not in ("yolos", *FIXED_SIZE)
    uses_timm = by_name and config.get("use_timm_backbone", True)
    if uses_timm or (backbone or {}).get("model_type") == "timm_backbone":
        if importlib.util.find_spec("timm") is None:
            raise DetectorError(
                f"{where}: its backbone needs the package timm, which is not installed; use a "
                "version of the model whose backbone_config is 'resnet'"
            )
    elif backbone is None and config.get("backbone"):
        name = config["backbone"]
        raise DetectorError(f"{where}: backbone '{name}' lies elsewhere; give a backbone_config")


def load_model(folder: Path) -> nn.Module:
    """The network of a folder; raises DetectorError where its weights do not fit."""
    from transformers import AutoModelForObjectDetection
    from transformers.utils import logging

    logging.disable_progress_bar()
    verbosity = logging.get_verbosity()
    logging.set_verbosity(logging.CRITICAL)  # what it would report becomes our one line
    try:
        model, report = AutoModelForObjectDetection.from_pretrained(
            folder,
            local_files_only=True,
            use_safetensors=True,
            dtype=torch.float32,
            ignore_mismatched_sizes=True,  # they are reported with the rest
            output_loading_info=True,
        )
    except Exception as error:  # transformers raises whatever a wrong file leads to
        reason = " ".join(str(error).split())
        raise DetectorError(f"{folder}: transformers cannot load it ({reason})") from error
    finally:
        logging.set_verbosity(verbosity)
    for problem in ("missing_keys", "mismatched_keys", "unexpected_keys"):
        if report[problem]:
            first = sorted(map(str, report[problem]))[0]
            kind = problem.removesuffix("_keys")
            raise DetectorError(f"{folder}: weights do not fit config.json: {kind} '{first}'")
    return model
