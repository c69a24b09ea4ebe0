"""A graph in ONNX Runtime: what enters it, and one call of it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import torch
from jaxtyping import Float
from torch import Tensor

from cnca.core.errors import DetectorError, did_you_mean
from cnca.detect.onnx_options import Options

TYPES = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(double)": np.float64,
    "tensor(uint8)": np.uint8,
    "tensor(int64)": np.int64,
    "tensor(int32)": np.int32,
}
MOST_PIXELS = 2**26
"""Most pixels in one call."""
ONES = ("scale_factor", "pixel_mask", "mask")
"""Further inputs by name: how much the picture was scaled, and which pixels are picture."""
HEIGHT_WIDTH, WIDTH_HEIGHT = ("im_shape", "image_shape"), ("orig_target_sizes", "orig_size")
"""Further inputs by name: the size to which boxes are scaled; here always that of the input."""

Pictures = Float[Tensor, "batch 3 height width"]
"""As many as the graph takes at once, of its input's size."""


class Runtime:
    """A session of ONNX Runtime that knows the size, type and order of axes of its pictures."""

    def __init__(self, path: Path, options: Options, model: onnx.ModelProto | None = None) -> None:
        """Open the file at ``path``, or ``model``, which was made from it.

        Raises:
            DetectorError: the file is missing, is not an ONNX model, or takes no pictures.
        """
        self.path = path
        self.session = _open_session(path, model)
        self._read_input(options)
        self.outputs = self._chosen_outputs(options)

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

    def _chosen_outputs(self, options: Options) -> list[str]:
        known = [output.name for output in self.session.get_outputs()]
        for name in options.outputs or ():
            if name not in known:
                place, hint = self.path.with_suffix(".yaml"), did_you_mean(name, known)
                there = f"the graph has {', '.join(known)}"
                raise DetectorError(f"{place}: no output '{name}'; {there}{hint}")
        return list(options.outputs or known)

    @property
    def takes_whole_numbers(self) -> bool:
        """Whether pictures enter as bytes or other whole numbers."""
        return bool(np.issubdtype(self.type, np.integer))

    def run(self, pictures: Pictures) -> dict[str, Tensor]:
        """One call of the network, without a gradient."""
        feed = {name: values.numpy() for name, values in self.inputs(pictures.detach()).items()}
        if self.takes_whole_numbers:
            feed[self.input_name] = feed[self.input_name].round()
        feed[self.input_name] = np.ascontiguousarray(feed[self.input_name].astype(self.type))
        found = self.session.run(self.outputs, feed)
        tensors = (torch.from_numpy(np.asarray(values)) for values in found)
        # Half precision becomes single; whole numbers stay, since they tell labels from scores.
        tensors = (t.float() if t.is_floating_point() else t for t in tensors)
        return dict(zip(self.outputs, tensors, strict=True))

    def inputs(self, pictures: Pictures) -> dict[str, Tensor]:
        """All inputs by name; the pictures in the graph's order of axes, in single precision."""
        ordered = pictures.permute(0, 2, 3, 1) if self.channels_last else pictures
        further = [e for e in self.session.get_inputs() if e.name != self.input_name]
        return {self.input_name: ordered} | {e.name: self._further_input(e) for e in further}

    def _further_input(self, entry: onnxruntime.NodeArg) -> Tensor:
        name, rank = entry.name, len(entry.shape)
        kind = TYPES.get(entry.type, np.float32)
        if name in ONES:
            values = np.ones((self.batch, *(self.size if rank == 3 else (2,))), kind)
        elif name in HEIGHT_WIDTH:
            values = np.array([self.size] * self.batch, kind)
        elif name in WIDTH_HEIGHT:
            values = np.array([self.size[::-1]] * self.batch, kind)
        else:
            raise DetectorError(
                f"{self.path}: input '{name}' is unknown; export the model with the picture alone"
            )
        return torch.from_numpy(values)


def _open_session(path: Path, model: onnx.ModelProto | None) -> onnxruntime.InferenceSession:
    if not path.is_file():
        raise DetectorError(f"{path}: no such file; give the path of an .onnx detector")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = torch.get_num_threads()
    options.log_severity_level = 3  # errors alone: warnings about shapes are not for the user
    source = path if model is None else model.SerializeToString()
    try:
        return onnxruntime.InferenceSession(source, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # ONNX Runtime's errors share no other base class
        reason = str(error).splitlines()[0]
        raise DetectorError(f"{path}: ONNX Runtime cannot open it ({reason})") from error
