"""Detectors by name or file.  Heavy libraries are imported when a detector is loaded."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cnca.core.errors import DetectorError, did_you_mean
from cnca.core.hub import HUB, hub_folder, is_hub_name
from cnca.core.plugins import is_plugin, load_plugin, plugin_file

if TYPE_CHECKING:
    import torch

    from cnca.scene.protocols import Detector

BUILTIN, TORCHVISION, DARKNET = "builtin", "torchvision:", "darknet:"
HUB_FILES = ("config.json", "preprocessor_config.json", "*.safetensors")
"""Files of a detector on the Hugging Face hub."""
_ASSETS = Path(__file__).parents[1] / "assets" / "detector"
BUILTIN_CONFIG = _ASSETS / "builtin.cfg"
TRAINED = {
    "yolo": BUILTIN_CONFIG,
    "anchor-free": _ASSETS / "anchor-free.cfg",
    "transformer": _ASSETS / "transformer",
}
"""What ``cnca train-detector --kind`` trains: Darknet configurations, a folder of transformers."""
BUILTINS = {BUILTIN: BUILTIN_CONFIG} | {
    f"{BUILTIN}:{kind}": TRAINED[kind] for kind in ("anchor-free", "transformer")
}
"""The built-in detectors by name, with their weights beside them once they are trained."""


def load_detector(spec: str, *, device: torch.device | str = "cpu") -> Detector:
    """Return the detector that ``spec`` names, ready to use on ``device``.

    ``spec`` is one of ``BUILTINS``; the path of a Darknet ``.cfg`` (the weights of the same stem,
    ``.weights`` or ``.safetensors``, lie beside it); the path of ``yolov3.weights`` or
    ``yolov3-tiny.weights``, whose configurations we know; the path of an ``.onnx`` file; a folder
    of transformers (``config.json`` and safetensors); ``torchvision:NAME:FILE``; or
    ``module:attribute``, a detector of one's own (:mod:`cnca.core.plugins`).  ``hf:OWNER/NAME``,
    ``torchvision:NAME`` and ``darknet:yolov3`` are fetched once (:mod:`cnca.core.hub`).

    Raises:
        DetectorError: the name is unknown, or a file is missing or cannot be used.
    """
    if spec.startswith(TORCHVISION):
        from cnca.detect.torchvision_models import TorchvisionDetector

        return TorchvisionDetector.load(spec, device=device)
    if _is_own(spec):
        from cnca.scene.protocols import Detector

        return load_plugin(spec, Detector, error=DetectorError)
    path = _path(spec)
    name = spec if spec in BUILTINS else _hub_name(spec)
    match path.suffix.lower():
        case ".cfg":
            from cnca.detect.white_box import DarknetDetector

            return DarknetDetector.load(path, device=device, name=name)
        case ".weights":
            from cnca.detect.white_box import DarknetDetector

            return DarknetDetector.load_weights(path, device=device)
        case ".onnx":
            from cnca.detect.onnx import OnnxDetector

            return OnnxDetector(path)
        case ".pt":
            raise DetectorError(
                f"{path}: reading .pt files of Ultralytics would run their code; export it: "
                f"yolo export model={path} format=onnx, then give {path.with_suffix('.onnx')}"
            )
    if path.is_dir() or spec.endswith("/"):
        from cnca.detect.transformer import TransformersDetector

        return TransformersDetector.load(path, device=device, name=name)
    known = f"{', '.join(BUILTINS)}, hf:OWNER/NAME, darknet:yolov3, {TORCHVISION}NAME[:FILE]"
    raise DetectorError(
        f"detector '{spec}': unknown; give {known}, module:attribute, the path of a .cfg, .weights "
        f"or .onnx file, or a folder of transformers{did_you_mean(spec, BUILTINS)}"
    )


def detector_files(spec: str) -> list[Path]:
    """What ``spec`` is read from: a file and its companions of the same stem, or a folder."""
    if _is_own(spec):
        file = plugin_file(spec)
        return [file] if file else []
    if spec.startswith(TORCHVISION):
        from cnca.detect.torchvision_models import weights_file

        path = weights_file(spec)
    else:
        path = _path(spec)
    return [path] if path.is_dir() else sorted(path.parent.glob(f"{path.stem}.*"))


def _path(spec: str) -> Path:
    """Where a detector lies; fetched first if its name refers to the net."""
    if is_hub_name(spec):
        return hub_folder(spec, HUB_FILES, DetectorError)
    if spec.startswith(DARKNET):
        from cnca.detect.yolov3 import published_weights

        return published_weights(spec.removeprefix(DARKNET))
    return BUILTINS.get(spec, Path(spec))


def _hub_name(spec: str) -> str | None:
    """The model's name without its owner; its folder in the cache is named by a number."""
    return spec.rpartition("/")[2].partition("@")[0] if is_hub_name(spec) else None


def _is_own(spec: str) -> bool:
    """Whether ``spec`` is ``module:attribute``, not one of the names that only look like it."""
    return is_plugin(spec) and not spec.startswith((f"{BUILTIN}:", TORCHVISION, DARKNET, HUB))
