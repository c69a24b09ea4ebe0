"""Detectors as ONNX files, run by ONNX Runtime: black boxes, without gradient."""

from __future__ import annotations

import ast
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnxruntime
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import pad

from cnca.core.errors import DetectorError, did_you_mean
from cnca.core.types import Candidates, SrgbImages
from cnca.detect.base import CandidateDetector
from cnca.detect.onnx_decode import Unknown
from cnca.detect.onnx_layouts import Outputs, find_layout
from cnca.detect.onnx_options import Options, read_options

TYPES = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(double)": np.float64,
    "tensor(uint8)": np.uint8,
    "tensor(int64)": np.int64,
    "tensor(int32)": np.int32,
}
MOST_PIXELS = 2**26
"""Of one call."""
ONES = ("scale_factor", "pixel_mask", "mask")
"""Further inputs by name: how much the picture was scaled, and where there is one."""
HEIGHT_WIDTH, WIDTH_HEIGHT = ("im_shape", "image_shape"), ("orig_target_sizes", "orig_size")
"""Further inputs by name: the size to which boxes are scaled; here always that of the input."""


class OnnxDetector(CandidateDetector):
    """A network of one of the layouts in :mod:`cnca.detect.onnx_layouts`.

    What the graph does not tell stands in a YAML file of the same stem beside it
    (:class:`cnca.detect.onnx_options.Options`).
    """

    differentiable = False

    def __init__(self, path: Path, *, name: str | None = None) -> None:
        """Open ``path``.

        Raises:
            DetectorError: the file is missing, is no ONNX model, or has an unknown layout.
        """
        self.path = path
        self.name = name or path.stem
        self.session = _open_session(path)
        options = read_options(path.with_suffix(".yaml"))
        self._read_input(options)
        self.outputs = _chosen_outputs(self.session, options, path)
        try:
            first = self._run(np.zeros((self.batch, 3, *self.size), np.float32))
        except DetectorError:
            raise
        except Exception as error:  # ONNX Runtime's errors share no other base class
            reason = str(error).splitlines()[0]
            raise DetectorError(f"{path}: ONNX Runtime cannot run it ({reason})") from error
        names = options.names() or _names_inside(self.session)
        try:
            self.layout = find_layout(first, self.size, names, options)
        except Unknown as error:
            shapes = ", ".join(f"{name} {tuple(o.shape)}" for name, o in first.items())
            raise DetectorError(
                f"{path}: outputs {shapes} for an input of {self.size}: {error}; state layout, "
                f"classes or strides in {path.with_suffix('.yaml').name}"
            ) from None
        self.entry = options.entry(self.layout.entry)
        self.class_names = tuple(self.layout.class_names)

    def _read_input(self, options: Options) -> None:
        """Type, order of axes, batch and size of the input that takes pictures."""
        inputs = self.session.get_inputs()
        picture = next((entry for entry in inputs if len(entry.shape) == 4), inputs[0])
        shape = picture.shape
        if len(shape) != 4 or 3 not in (shape[1], shape[3]):
            raise DetectorError(
                f"{self.path}: input '{picture.name}' has shape {shape}, must be "
                "(batch, 3, height, width) or (batch, height, width, 3)"
            )
        self.input_name: str = picture.name
        self.channels_last = shape[1] != 3
        self.batch = shape[0] if isinstance(shape[0], int) else 1
        self.type = TYPES.get(picture.type, np.float32)
        size = shape[1:3] if self.channels_last else shape[2:4]
        if not all(isinstance(pixels, int) for pixels in size):
            if options.size is None:
                raise DetectorError(
                    f"{self.path}: input '{picture.name}' has shape {shape}; state size: [height, "
                    f"width] in {self.path.with_suffix('.yaml').name}, or export with a fixed one"
                )
            size = options.size
        self.size = (int(size[0]), int(size[1]))
        if min(self.batch, *self.size) < 1 or self.batch * math.prod(self.size) > MOST_PIXELS:
            raise DetectorError(
                f"{self.path}: input '{picture.name}' takes {self.batch} pictures of "
                f"{self.size[0]} × {self.size[1]} pixels; export it for pictures of a usual size"
            )

    @torch.no_grad()
    def candidates(self, images: SrgbImages) -> Candidates:
        """Return all boxes in pixels of ``images``, without gradient, on the images' device."""
        inputs, placement = self.entry.prepare(SrgbImages(images.float().cpu()), self.size)
        parts = []
        for part in inputs.split(self.batch):
            # The batch of the graph is fixed: a smaller part is filled up with zeros.
            filled = pad(part, (0, 0, 0, 0, 0, 0, 0, self.batch - len(part)))
            found = self.layout.decode(self._run(filled.numpy()))
            parts.append([t[: len(part)] for t in vars(found).values()])
        boxes, objectness, scores = (
            _stacked(part).to(images.device) for part in zip(*parts, strict=True)
        )
        return Candidates(placement.back(boxes), objectness, scores)

    def _run(self, inputs: Float[np.ndarray, "batch 3 height width"]) -> Outputs:
        """One call of the network."""
        if self.channels_last:
            inputs = inputs.transpose(0, 2, 3, 1)
        if np.issubdtype(self.type, np.integer):
            inputs = inputs.round()
        feed = {self.input_name: np.ascontiguousarray(inputs.astype(self.type))}
        for other in self.session.get_inputs():
            if other.name != self.input_name:
                feed[other.name] = self._further_input(other)
        found = self.session.run(self.outputs, feed)
        tensors = (torch.from_numpy(np.asarray(values)) for values in found)
        # Half precision becomes single; whole numbers stay, they tell labels from scores.
        tensors = (t.float() if t.is_floating_point() else t for t in tensors)
        return dict(zip(self.outputs, tensors, strict=True))

    def _further_input(self, entry: onnxruntime.NodeArg) -> np.ndarray:
        name, rank = entry.name, len(entry.shape)
        kind = TYPES.get(entry.type, np.float32)
        if name in ONES:
            return np.ones((self.batch, *(self.size if rank == 3 else (2,))), kind)
        if name in HEIGHT_WIDTH:
            return np.array([self.size] * self.batch, kind)
        if name in WIDTH_HEIGHT:
            return np.array([self.size[::-1]] * self.batch, kind)
        raise DetectorError(
            f"{self.path}: input '{name}' is unknown; export the model with the picture alone"
        )


def _open_session(path: Path) -> onnxruntime.InferenceSession:
    if not path.is_file():
        raise DetectorError(f"{path}: no such file; give the path of an .onnx detector")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = torch.get_num_threads()
    options.log_severity_level = 3  # errors alone: warnings about shapes are not the user's
    try:
        return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # ONNX Runtime's errors share no other base class
        reason = str(error).splitlines()[0]
        raise DetectorError(f"{path}: ONNX Runtime cannot open it ({reason})") from error


def _chosen_outputs(
    session: onnxruntime.InferenceSession, options: Options, path: Path
) -> list[str]:
    known = [output.name for output in session.get_outputs()]
    for name in options.outputs or ():
        if name not in known:
            hint = did_you_mean(name, known)
            there = f"the graph has {', '.join(known)}"
            raise DetectorError(f"{path.with_suffix('.yaml')}: no output '{name}'; {there}{hint}")
    return list(options.outputs or known)


def _names_inside(session: onnxruntime.InferenceSession) -> Sequence[str] | None:
    """The class names that Ultralytics' exports carry, ``{0: 'person', …}``."""
    try:
        names = ast.literal_eval(session.get_modelmeta().custom_metadata_map["names"])
        return tuple(names[i] for i in range(len(names))) if isinstance(names, dict) else None
    except (KeyError, ValueError, TypeError, SyntaxError, RecursionError, MemoryError):
        return None


def _stacked(parts: Sequence[Tensor]) -> Tensor:
    """Join calls along the batch; where one found fewer boxes, boxes of score 0 are added."""
    most = max(part.shape[1] for part in parts)
    filled = [pad(part, (0, 0) * (part.ndim - 2) + (0, most - part.shape[1])) for part in parts]
    return torch.cat(filled)
