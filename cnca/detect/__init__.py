"""Detectors by name or file.  Heavy libraries are imported when a detector is loaded."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cnca.core.errors import DetectorError, did_you_mean
from cnca.core.plugins import is_plugin, load_plugin, plugin_file

if TYPE_CHECKING:
    import torch

    from cnca.scene.protocols import Detector

BUILTIN, TORCHVISION = "builtin", "torchvision:"
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
    ``module:attribute``, a detector of one's own (:mod:`cnca.core.plugins`).

    Raises:
        DetectorError: the name is unknown, or a file is missing or cannot be used.
    """
    if spec.startswith(TORCHVISION):
        from cnca.detect.torchvision_models import TorchvisionDetector

        return TorchvisionDetector.load(spec, device=device)
    if _is_own(spec):
        from cnca.scene.protocols import Detector

        return load_plugin(spec, Detector, error=DetectorError)
    path = BUILTINS.get(spec, Path(spec))
    name = spec if spec in BUILTINS else None
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
    if path.is_dir() or spec.endswith("/"):
        from cnca.detect.transformer import TransformersDetector

        return TransformersDetector.load(path, device=device, name=name)
    known = f"{', '.join(BUILTINS)}, {TORCHVISION}NAME:FILE, module:attribute"
    raise DetectorError(
        f"detector '{spec}': unknown; give {known}, the path of a .cfg, .weights or .onnx file, or "
        f"a folder of transformers{did_you_mean(spec, BUILTINS)}"
    )


def detector_files(spec: str) -> list[Path]:
    """What ``spec`` is read from: a file and its companions of the same stem, or a folder."""
    if _is_own(spec):
        file = plugin_file(spec)
        return [file] if file else []
    path = BUILTINS.get(spec, Path(spec))
    if spec.startswith(TORCHVISION):
        path = Path(spec.split(":", 2)[-1])
    return [path] if path.is_dir() else sorted(path.parent.glob(f"{path.stem}.*"))


def _is_own(spec: str) -> bool:
    """Whether it is ``module:attribute`` and none of the names that only look like it."""
    return is_plugin(spec) and not spec.startswith((f"{BUILTIN}:", TORCHVISION))
