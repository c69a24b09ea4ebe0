"""Cutting suppression off a graph: what is left ends where all candidates are still there."""

from __future__ import annotations

import onnx

SUPPRESSIONS = {
    "NonMaxSuppression",
    "EfficientNMS_TRT",
    "BatchedNMS_TRT",
    "BatchedNMSDynamic_TRT",
    "TRTBatchedNMS",
    "EfficientNMS_ONNX_TRT",
}
"""ONNX's own operation, and TensorRT's, which ONNX Runtime does not know."""


def suppressing(model: onnx.ModelProto) -> list[onnx.NodeProto]:
    """The nodes of ``model`` that suppress boxes; their first inputs are boxes and scores."""
    return [node for node in model.graph.node if node.op_type in SUPPRESSIONS]


def ending_at(model: onnx.ModelProto, names: list[str]) -> onnx.ModelProto:
    """A copy of ``model`` whose outputs are the values ``names``, without what they do not need."""
    kept, wanted = [], set(names)
    for node in reversed(model.graph.node):
        if wanted.intersection(node.output):
            kept.append(node)
            wanted.update(node.input)
    shorter = onnx.ModelProto()
    shorter.CopyFrom(model)
    graph = shorter.graph
    del graph.node[:], graph.output[:]
    graph.node.extend(reversed(kept))
    # Without a type: ONNX Runtime finds it.
    graph.output.extend(onnx.ValueInfoProto(name=name) for name in names)
    unused = [entry for entry in graph.initializer if entry.name not in wanted]
    for entry in unused:
        graph.initializer.remove(entry)
    return shorter


def before(model: onnx.ModelProto, node: onnx.NodeProto) -> list[str]:
    """The values that enter ``node``, and those before them; the nearest first."""
    reached, names = set(node.input), list(node.input)
    for other in reversed(model.graph.node):
        if reached.intersection(other.output) and other.op_type != "Constant":
            names += [name for name in other.input if name and name not in reached]
            reached.update(other.input)
    constants = {entry.name for entry in model.graph.initializer}
    constants |= {n for o in model.graph.node if o.op_type == "Constant" for n in o.output}
    return [name for name in names if name and name not in constants]
