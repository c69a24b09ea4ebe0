"""Detectors as ONNX files, run by ONNX Runtime: black boxes, without gradient."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnxruntime
import torch
from jaxtyping import Float
from torch import Tensor

from cnca.boxes import cxcywh_to_xyxy
from cnca.detect.base import CandidateDetector
from cnca.detect.coco import CLASS_NAMES
from cnca.detect.preprocess import Placement, letterbox
from cnca.errors import DetectorError
from cnca.types import Candidates, SrgbImages

YOLOX_STRIDES = (8, 16, 32)
Output = Float[Tensor, "batch candidates values"]


@dataclass(frozen=True)
class Layout:
    """How pictures enter a family of networks and boxes leave it."""

    fits: Callable[[tuple[int, int], tuple[int, ...]], bool]
    """Whether an input (height, width) and an output shape are of this family."""
    prepare: Callable[[SrgbImages, tuple[int, int]], tuple[Tensor, Placement]]
    """Display values in [0, 1] → the network's input of (height, width)."""
    decode: Callable[[Output, tuple[int, int]], Candidates]
    """The network's output → candidates in pixels of its input."""


def yolox_cells(size: tuple[int, int]) -> Float[Tensor, "candidates 3"]:
    """Column, row and stride of each of YOLOX's candidates, in the order of its output."""
    cells = []
    for stride in YOLOX_STRIDES:
        rows, columns = torch.arange(size[0] // stride), torch.arange(size[1] // stride)
        y, x = torch.meshgrid(rows, columns, indexing="ij")
        cells.append(torch.stack([x, y, torch.full_like(x, stride)], dim=-1).reshape(-1, 3))
    return torch.cat(cells).float()


def _fits_yolox(size: tuple[int, int], output: tuple[int, ...]) -> bool:
    expected = sum((size[0] // stride) * (size[1] // stride) for stride in YOLOX_STRIDES)
    return len(output) == 3 and output[1] == expected and output[2] == 5 + len(CLASS_NAMES)


def _prepare_yolox(images: SrgbImages, size: tuple[int, int]) -> tuple[Tensor, Placement]:
    """BGR in [0, 255], at the top left of a field of grey 114."""
    inputs, placement = letterbox(images, size, grey=114 / 255, centred=False)
    return inputs.flip(1) * 255, placement


def _decode_yolox(output: Output, size: tuple[int, int]) -> Candidates:
    """Centres are offsets from the cell, sizes are logarithms, both in strides (Ge et al. 2021)."""
    cells = yolox_cells(size).to(output)
    origin, stride = cells[:, :2], cells[:, 2:]
    centres = (output[..., :2] + origin) * stride
    sizes = output[..., 2:4].exp() * stride
    boxes = cxcywh_to_xyxy(torch.cat([centres, sizes], dim=-1))
    return Candidates(boxes, objectness=output[..., 4], class_scores=output[..., 5:])


LAYOUTS: dict[str, Layout] = {
    "yolox": Layout(_fits_yolox, _prepare_yolox, _decode_yolox),
}


class OnnxDetector(CandidateDetector):
    """A network of a known layout, with COCO's classes."""

    differentiable = False

    def __init__(self, path: Path, *, name: str | None = None) -> None:
        """Open ``path``.

        Raises:
            DetectorError: the file is missing, is no ONNX model, or has an unknown layout.
        """
        self.session = _open_session(path)
        model_input, model_output = self.session.get_inputs()[0], self.session.get_outputs()[0]
        if len(model_input.shape) != 4 or not all(isinstance(n, int) for n in model_input.shape):
            raise DetectorError(
                f"{path}: input '{model_input.name}' has shape {model_input.shape}; "
                "export the model with a fixed input (batch, 3, height, width)"
            )
        self.name = name or path.stem
        self.class_names = CLASS_NAMES
        self.input_name: str = model_input.name
        self.batch = int(model_input.shape[0])
        self.size = (int(model_input.shape[2]), int(model_input.shape[3]))
        self.layout = _layout_of(path, self.size, tuple(model_output.shape))

    @torch.no_grad()
    def candidates(self, images: SrgbImages) -> Candidates:
        """Return all boxes in pixels of ``images``, without gradient, on the images' device."""
        inputs, placement = self.layout.prepare(images.float(), self.size)
        output = torch.cat([self._run(part) for part in inputs.cpu().split(self.batch)])
        found = self.layout.decode(output.to(images.device), self.size)
        return Candidates(placement.back(found.boxes), found.objectness, found.class_scores)

    def _run(self, inputs: Float[Tensor, "part 3 height width"]) -> Output:
        """One call of the network, whose batch is fixed: a smaller part is filled up with zeros."""
        batch = np.zeros((self.batch, *inputs.shape[1:]), np.float32)
        batch[: len(inputs)] = inputs.numpy()
        output = self.session.run(None, {self.input_name: batch})[0]
        return torch.from_numpy(output[: len(inputs)])


def _open_session(path: Path) -> onnxruntime.InferenceSession:
    if not path.is_file():
        raise DetectorError(f"{path}: no such file; give the path of an .onnx detector")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = torch.get_num_threads()
    try:
        return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # ONNX Runtime's errors share no other base class
        reason = str(error).splitlines()[0]
        raise DetectorError(f"{path}: ONNX Runtime cannot open it ({reason})") from error


def _layout_of(path: Path, size: tuple[int, int], output: tuple[int, ...]) -> Layout:
    for layout in LAYOUTS.values():
        if layout.fits(size, output):
            return layout
    raise DetectorError(
        f"{path}: input {size} with output {output} is of no known layout ({', '.join(LAYOUTS)})"
    )
