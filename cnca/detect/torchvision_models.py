"""Detectors of torchvision, where it is installed: white boxes."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import load_file
from torch import Tensor, nn
from torch.nn.functional import one_hot, pad

from cnca.core.errors import DetectorError, did_you_mean
from cnca.core.hub import refuse_offline
from cnca.core.types import Candidates, SrgbImages
from cnca.detect import TORCHVISION
from cnca.detect.base import CandidateDetector
from cnca.detect.classes import COCO91, read_names

FAMILIES = ("fasterrcnn", "retinanet", "ssd", "fcos")
MOST, LEAST_SCORE = 1000, 0.001
"""How many of each picture's boxes are kept, the best, and the score that they need for it."""


class TorchvisionDetector(CandidateDetector):
    """Faster R-CNN, RetinaNet, SSD or FCOS; resizing and normalizing are the model's own.

    The model's suppression is off.  Each candidate is a box for one class; boxes of score 0
    fill up to ``MOST``.
    """

    differentiable = True

    def __init__(self, model: nn.Module, class_names: tuple[str, ...], name: str) -> None:
        self.model = model.eval().requires_grad_(False)
        self.class_names = class_names
        self.name = name
        last: Any = getattr(model, "roi_heads", model)
        last.score_thresh, last.nms_thresh, last.detections_per_img = LEAST_SCORE, 1.0, MOST

    @classmethod
    def load(cls, spec: str, *, device: torch.device | str = "cpu") -> TorchvisionDetector:
        """Read ``torchvision:NAME:FILE``, such as ``torchvision:fcos_resnet50_fpn:fcos.pth``.

        FILE (``.pth`` or ``.safetensors``) holds the weights; without it torchvision's own are
        fetched once into torch's cache.  Classes are COCO's by their numbers,
        or the lines of FILE's ``.names``, the first of which names the background.

        Raises:
            DetectorError: torchvision is missing, or the name or file is wrong.
        """
        name, colon, file = spec.removeprefix(TORCHVISION).partition(":")
        if not name or bool(colon) != bool(file):
            raise DetectorError(
                f"detector '{spec}': write {TORCHVISION}NAME:FILE, FILE being weights, or "
                f"{TORCHVISION}NAME for torchvision's own"
            )
        path = weights_file(spec)
        names = path.with_suffix(".names")
        class_names = tuple(read_names(names)) if names.is_file() else COCO91
        model = _build(name, len(class_names))
        _load(model, path)
        return cls(model.to(device), class_names, name)

    def candidates(self, images: SrgbImages) -> Candidates:
        """Return the best boxes before suppression in pixels of ``images``; differentiable.

        Images of another type or device are brought to the model's, where the results stay.
        """
        images = SrgbImages(images.to(next(self.model.parameters())))
        found = [self._fill(one) for one in self.model(list(images))]
        boxes, scores = (torch.stack(part) for part in zip(*found, strict=True))
        return Candidates(boxes, torch.ones_like(scores[..., 0]), scores)

    def _fill(self, found: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
        """One picture's boxes (MOST, 4) and scores (MOST, classes)."""
        columns = one_hot(found["labels"], len(self.class_names))
        missing = (0, 0, 0, MOST - len(columns))
        return pad(found["boxes"], missing), pad(columns * found["scores"][:, None], missing)


def weights_file(spec: str) -> Path:
    """The file of ``torchvision:NAME[:FILE]``; torchvision's own weights are fetched once.

    Raises DetectorError where torchvision is missing, or for a name that it has no weights for.
    """
    name, _, file = spec.removeprefix(TORCHVISION).partition(":")
    if importlib.util.find_spec("torchvision") is None:
        raise DetectorError(
            f"detector '{spec}': needs the package torchvision, which is not installed; "
            f"install the one that belongs to torch {torch.__version__.partition('+')[0]}"
        )
    return Path(file) if file else _published(name)


def _published(name: str) -> Path:
    from torchvision.models import get_model_weights

    _check_name(name)
    address: str = get_model_weights(name).DEFAULT.url
    path = Path(torch.hub.get_dir()) / "checkpoints" / address.rpartition("/")[2]
    if not path.is_file():
        refuse_offline(TORCHVISION + name, DetectorError)
        path.parent.mkdir(parents=True, exist_ok=True)
        digits = path.stem.rpartition("-")[2]  # of the SHA-256, by torchvision's own rule
        try:
            torch.hub.download_url_to_file(address, str(path), digits, progress=False)
        except (OSError, RuntimeError) as error:
            reason = " ".join(str(error).split())[:120]
            raise DetectorError(
                f"{TORCHVISION}{name}: {address} cannot be fetched ({reason}); is there a network?"
            ) from error
    return path


def _build(name: str, classes: int) -> nn.Module:
    from torchvision.models import get_model

    _check_name(name)
    return get_model(name, weights=None, weights_backbone=None, num_classes=classes)


def _check_name(name: str) -> None:
    from torchvision.models import detection as models
    from torchvision.models import list_models

    known = [n for n in list_models(module=models) if n.startswith(FAMILIES)]
    if name not in known:
        hint = did_you_mean(name, known)
        raise DetectorError(f"{TORCHVISION}{name}: unknown; there is {', '.join(known)}{hint}")


def _load(model: nn.Module, path: Path) -> None:
    try:
        if path.suffix == ".safetensors":
            tensors = load_file(path)
        else:
            tensors = torch.load(path, map_location="cpu", weights_only=True)
        model.load_state_dict(tensors)
    except Exception as error:  # a wrong file fails in many ways, none of them ours
        reason = " ".join(str(error).split())[:200]
        raise DetectorError(f"{path}: weights cannot be used ({reason})") from error
