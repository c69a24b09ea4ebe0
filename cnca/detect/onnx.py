"""Detectors as ONNX files: white boxes where torch computes the same as ONNX Runtime."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from pathlib import Path

import onnx
import torch
from torch import Tensor
from torch.nn.functional import pad

from cnca.core.errors import DetectorError
from cnca.core.types import Candidates, SrgbImages
from cnca.detect.base import CandidateDetector
from cnca.detect.conventions import settled
from cnca.detect.graph.check import NoGradientError, white_box
from cnca.detect.graph.network import OnnxNetwork
from cnca.detect.onnx_decode import Unknown
from cnca.detect.onnx_heads import heads, read_model
from cnca.detect.onnx_layout import Layout, Outputs
from cnca.detect.onnx_layouts import find_layout
from cnca.detect.onnx_options import Options, read_options
from cnca.detect.onnx_runtime import Pictures, Runtime


class OnnxDetector(CandidateDetector):
    """A network of one of the layouts in :mod:`cnca.detect.onnx_layouts`.

    What the graph does not tell is stated in a YAML file of the same stem beside it
    (:class:`cnca.detect.onnx_options.Options`).  Pictures that ask for a gradient go through the
    same graph in torch; all others through ONNX Runtime, which is faster.
    """

    def __init__(self, path: Path, *, name: str | None = None) -> None:
        """Open ``path``.

        Raises:
            DetectorError: the file is missing, is not an ONNX model, or has an unknown layout.
        """
        self.path = path
        self.name = name or path.stem
        self.options = read_options(path.with_suffix(".yaml"))
        own = read_model(path)
        self.runtime, usual, model = self._open(own)
        self.layout, self.note = settled(
            usual, self.options, self.runtime.size, self._answer, self._find
        )
        self.entry = self.options.entry(self.layout.entry)
        self.class_names = tuple(self.layout.class_names)
        self.network: OnnxNetwork | None = None
        try:
            self.network = self._in_torch(model)
        except NoGradientError as error:
            self.why_black = str(error)
        self.differentiable = self.network is not None

    def _find(self, outputs: Outputs, options: Options) -> Layout:
        names = options.names() or _names_inside(self.runtime)
        return find_layout(outputs, self.runtime.size, names, options)

    def _answer(self, picture: Tensor) -> Outputs:
        """What the network makes of one picture; the rest of a fixed batch is zeros."""
        return self.runtime.run(pad(picture, (0, 0, 0, 0, 0, 0, 0, self.runtime.batch - 1)))

    def _open(self, own: onnx.ModelProto | None) -> tuple[Runtime, Layout, onnx.ModelProto | None]:
        """The first head with a known layout, and the graph that ends there."""
        *early, (_, last) = heads(self.path, own, self.options)
        for model, options in early:
            try:
                return *self._head(Runtime(self.path, options, model), options), model
            except (DetectorError, Unknown):
                continue
        runtime = Runtime(self.path, last)
        try:
            return *self._head(runtime, last), own
        except Unknown as error:
            raise DetectorError(
                f"{self.path}: {error}; state layout, classes or strides in "
                f"{self.path.with_suffix('.yaml').name}"
            ) from None

    def _head(self, runtime: Runtime, options: Options) -> tuple[Runtime, Layout]:
        """How boxes leave the network, told from zero input; raises Unknown or DetectorError."""
        try:
            first = runtime.run(torch.zeros(runtime.batch, 3, *runtime.size))
        except DetectorError:
            raise
        except Exception as error:  # ONNX Runtime's errors share no other base class
            reason = str(error).splitlines()[0]
            raise DetectorError(f"{self.path}: ONNX Runtime cannot run it ({reason})") from error
        names = options.names() or _names_inside(runtime)
        try:
            return runtime, find_layout(first, runtime.size, names, options)
        except Unknown as error:
            shapes = ", ".join(f"{name} {tuple(o.shape)}" for name, o in first.items())
            raise Unknown(f"outputs {shapes} for an input of {runtime.size}: {error}") from None

    def _in_torch(self, model: onnx.ModelProto | None) -> OnnxNetwork:
        """The graph in torch, compared with ONNX Runtime on noise; raises NoGradientError."""
        if model is None:
            raise NoGradientError("the file cannot be read by the package onnx")
        size = (self.runtime.batch, 3, *self.runtime.size)
        noise = torch.rand(size, generator=torch.Generator().manual_seed(0))
        pictures, _ = self.entry.prepare(SrgbImages(noise), self.runtime.size)
        pictures = pictures.round() if self.runtime.takes_whole_numbers else pictures
        inputs, expected = self.runtime.inputs(pictures), self.runtime.run(pictures)
        return white_box(model, inputs, self.runtime.input_name, expected)

    def candidates(self, images: SrgbImages) -> Candidates:
        """Return all boxes in pixels of ``images``, on the images' device.

        Differentiable in ``images`` where the detector is.
        """
        size, batch = self.runtime.size, self.runtime.batch
        inputs, placement = self.entry.prepare(SrgbImages(images.float().cpu()), size)
        parts = []
        for part in inputs.split(batch):
            # The batch of the graph is fixed: a smaller part is filled up with zeros.
            filled = pad(part, (0, 0, 0, 0, 0, 0, 0, batch - len(part)))
            found = self.layout.decode(self._outputs(filled))
            parts.append([t[: len(part)] for t in vars(found).values()])
        boxes, objectness, scores = (
            _stacked(part).to(images.device) for part in zip(*parts, strict=True)
        )
        return Candidates(placement.back(boxes), objectness, scores)

    def _outputs(self, pictures: Pictures) -> Mapping[str, Tensor]:
        """One call of the network, with a gradient where one is asked for."""
        if self.network is None or not pictures.requires_grad:
            return self.runtime.run(pictures)
        found = self.network(self.runtime.inputs(pictures))
        return {name: found[name] for name in self.runtime.outputs}


def _names_inside(runtime: Runtime) -> Sequence[str] | None:
    """The class names that Ultralytics' exports carry, ``{0: 'person', …}``."""
    try:
        names = ast.literal_eval(runtime.session.get_modelmeta().custom_metadata_map["names"])
        return tuple(names[i] for i in range(len(names))) if isinstance(names, dict) else None
    except (KeyError, ValueError, TypeError, SyntaxError, RecursionError, MemoryError):
        return None


def _stacked(parts: Sequence[Tensor]) -> Tensor:
    """Join calls along the batch; where one found fewer boxes, boxes of score 0 are added."""
    most = max(part.shape[1] for part in parts)
    filled = [pad(part, (0, 0) * (part.ndim - 2) + (0, most - part.shape[1])) for part in parts]
    return torch.cat(filled)
