"""An ONNX graph as a torch module: its nodes are computed one after the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import onnx
import torch
from onnx import numpy_helper
from torch import Tensor, nn

from cnca.detect.graph import arithmetic, arrangement, layers, reductions, resize
from cnca.detect.graph.node import Node, Operation, UnsupportedError, Values

OPERATIONS: Mapping[str, Operation] = {
    **arithmetic.OPERATIONS,
    **arrangement.OPERATIONS,
    **layers.OPERATIONS,
    **reductions.OPERATIONS,
    **resize.OPERATIONS,
}
"""Operation by its name in ONNX."""
DOMAINS = ("", "ai.onnx")
"""Domains of ONNX's own operations."""


class OnnxNetwork(nn.Module):
    """Computes what the graph of ``model`` says; differentiable in its inputs.

    Weights are buffers.  Half precision becomes single.
    """

    def __init__(self, model: onnx.ModelProto) -> None:
        """Read the nodes and weights.

        Raises:
            UnsupportedError: an operation is unknown; the error names it.
        """
        super().__init__()
        opset = max(entry.version for entry in model.opset_import if entry.domain in DOMAINS)
        graph = model.graph
        self.constants = {entry.name: _tensor(entry) for entry in graph.initializer}
        self.nodes: list[Node] = []
        for proto in graph.node:
            attributes = {a.name: _attribute(a) for a in proto.attribute}
            if proto.op_type == "Constant":
                self.constants[proto.output[0]] = _constant(attributes)
                continue
            if proto.op_type not in OPERATIONS or proto.domain not in DOMAINS:
                raise UnsupportedError(f"operation {proto.op_type} is not supported")
            self.nodes.append(
                Node(proto.op_type, list(proto.input), list(proto.output), opset, attributes)
            )
        self.outputs = [entry.name for entry in graph.output]
        self._weights = {}
        for number, (name, tensor) in enumerate(self.constants.items()):
            if tensor.is_floating_point():  # whole numbers are shapes, which stay on the CPU
                self.register_buffer(f"weight_{number}", tensor)
                self._weights[name] = f"weight_{number}"
        self._last_use = self._find_last_uses()

    def forward(self, inputs: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Outputs by name from inputs by name."""
        known: dict[str, Tensor] = {**self.constants, **inputs}
        known |= {name: getattr(self, buffer) for name, buffer in self._weights.items()}
        for number, node in enumerate(self.nodes):
            values = [known[name] if name else None for name in node.inputs]
            known.update(zip(node.outputs, self._compute(node, values), strict=False))
            for name in self._last_use[number]:
                del known[name]
        return {name: known[name] for name in self.outputs}

    def _compute(self, node: Node, values: Values) -> Sequence[Tensor]:
        result = OPERATIONS[node.operation](node, values)
        return [result] if isinstance(result, Tensor) else result

    def _find_last_uses(self) -> list[list[str]]:
        """For each node, the values that no node after it needs."""
        seen = {*self.outputs, ""}
        last: list[list[str]] = []
        for node in reversed(self.nodes):
            done = [n for n in dict.fromkeys([*node.inputs, *node.outputs]) if n not in seen]
            seen.update(done)
            last.append(done)
        return last[::-1]


def _constant(attributes: Mapping[str, Any]) -> Tensor:
    """The value of a ``Constant``, which stands in one of several attributes."""
    (value,) = attributes.values()
    return value if isinstance(value, Tensor) else torch.tensor(value)


def _attribute(proto: onnx.AttributeProto) -> Any:
    """A plain value; tensors become torch's."""
    if proto.type in (onnx.AttributeProto.GRAPH, onnx.AttributeProto.GRAPHS):
        return None  # of operations that are not supported
    value = onnx.helper.get_attribute_value(proto)
    return _tensor(value) if isinstance(value, onnx.TensorProto) else value


def _tensor(proto: onnx.TensorProto) -> Tensor:
    array = numpy_helper.to_array(proto)
    if array.dtype.kind in "fV" and array.dtype.itemsize < 4:
        array = array.astype(np.float32)
    if array.dtype.kind not in "fiub":
        raise UnsupportedError(f"values of type {array.dtype} are not supported")
    return torch.from_numpy(np.array(array))
