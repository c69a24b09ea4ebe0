"""Where boxes can be read off an ONNX graph: before suppression if it has one, else at its end."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import onnx
import torch

from cnca.detect.graph.suppression import before, ending_at, suppressing
from cnca.detect.onnx_decode import cells_of_strides
from cnca.detect.onnx_layout import ANCHORS_PER_CELL, STRIDES
from cnca.detect.onnx_options import Options
from cnca.detect.onnx_runtime import Runtime

Head = tuple[onnx.ModelProto | None, Options]
"""A graph that ends where boxes are read, None for the file's own, and what is known of them."""


def read_model(path: Path) -> onnx.ModelProto | None:
    """The graph in ``path``; None where it cannot be read, about which ONNX Runtime says more."""
    try:
        return onnx.load(str(path))
    except Exception:  # protobuf's errors share no public base class
        return None


def heads(path: Path, model: onnx.ModelProto | None, options: Options) -> Iterator[Head]:
    """All places to try, the best first; the last one is the end of the graph.

    Suppression hides candidates, all of which an attack needs, and has a threshold of its own.
    Where the user names outputs or a layout, no other place is tried.
    """
    if model is not None and options.outputs is None and options.layout is None:
        for node in suppressing(model):
            yield ending_at(model, list(node.input[:2])), _notation(node, options)
            for name in _tables(path, model, node, options):
                yield ending_at(model, [name]), options
    yield None, options


def _notation(node: onnx.NodeProto, options: Options) -> Options:
    """Suppression says how its boxes are written; networks from torch give it xyxy for yxyx."""
    said = {attribute.name: attribute.i for attribute in node.attribute}
    centred = said.get("center_point_box", 0) or said.get("box_coding", 0)
    return options.model_copy(update={"boxes": options.boxes or ("cxcywh" if centred else "xyxy")})


def _tables(
    path: Path, model: onnx.ModelProto, node: onnx.NodeProto, options: Options
) -> list[str]:
    """Values before ``node`` with one row for each cell or anchor, the nearest first."""
    names = before(model, node)
    try:
        runtime = Runtime(path, options, ending_at(model, names))
        found = runtime.run(torch.zeros(runtime.batch, 3, *runtime.size))
    except Exception:  # an operation that ONNX Runtime does not know: there is no head before it
        return []
    grids = [len(cells_of_strides(runtime.size, strides)) for strides in STRIDES]
    rows = {count * anchors for count in grids for anchors in ANCHORS_PER_CELL}
    return [n for n, t in found.items() if t.ndim == 3 and rows & {t.shape[1], t.shape[2]}]
