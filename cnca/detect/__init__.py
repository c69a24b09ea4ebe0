"""Detectors by name or file.  Heavy libraries are imported when a detector is loaded."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cnca.errors import DetectorError, did_you_mean

if TYPE_CHECKING:
    import torch

    from cnca.protocols import Detector

BUILTIN = "builtin"
BUILTIN_CONFIG = Path(__file__).parents[1] / "assets" / "detector" / "builtin.cfg"
"""The built-in detector is an ordinary Darknet configuration, with weights and names beside it."""


def load_detector(spec: str, *, device: torch.device | str = "cpu") -> Detector:
    """Return the detector that ``spec`` names, ready to use on ``device``.

    ``spec`` is ``builtin``, the path of a Darknet ``.cfg`` (the weights of the same stem,
    ``.weights`` or ``.safetensors``, lie beside it), or the path of an ``.onnx`` file.

    Raises:
        DetectorError: the name is unknown, or a file is missing or cannot be used.
    """
    path = BUILTIN_CONFIG if spec == BUILTIN else Path(spec)
    match path.suffix.lower():
        case ".cfg":
            from cnca.detect.white_box import DarknetDetector

            return DarknetDetector.load(path, device=device, name=path.stem)
        case ".onnx":
            from cnca.detect.onnx import OnnxDetector

            return OnnxDetector(path)
    hint = did_you_mean(spec, [BUILTIN])
    raise DetectorError(
        f"detector '{spec}': unknown; give '{BUILTIN}', or the path of a .cfg or .onnx file{hint}"
    )
