"""One operation of a graph, as the ONNX specification describes it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import onnx
import torch
from torch import Tensor

TENSOR_TYPES: Mapping[int, torch.dtype] = {
    onnx.TensorProto.FLOAT: torch.float32,
    # Half precision would be slow and coarse on a CPU: values are kept in single precision.
    onnx.TensorProto.FLOAT16: torch.float32,
    onnx.TensorProto.BFLOAT16: torch.float32,
    onnx.TensorProto.DOUBLE: torch.float64,
    onnx.TensorProto.INT64: torch.int64,
    onnx.TensorProto.INT32: torch.int32,
    onnx.TensorProto.INT16: torch.int16,
    onnx.TensorProto.INT8: torch.int8,
    onnx.TensorProto.UINT8: torch.uint8,
    onnx.TensorProto.BOOL: torch.bool,
}
"""ONNX's number of an element type → torch's type."""


class UnsupportedError(ValueError):
    """The graph holds something that has no counterpart here."""


@dataclass(frozen=True)
class Node:
    """An operation with its attributes."""

    operation: str
    inputs: Sequence[str]
    """Names of values; "" where an optional input is left out."""
    outputs: Sequence[str]
    opset: int
    """Version of ONNX's operator set by which the node is to be read."""
    attributes: Mapping[str, Any] = field(default_factory=dict)

    def get(self, name: str, default: Any) -> Any:
        """The attribute's value, or the specification's ``default``."""
        return self.attributes.get(name, default)

    def numbers(self, name: str, values: Values, position: int) -> list[int] | None:
        """What older opsets have as an attribute and newer ones as an input, such as axes."""
        if name in self.attributes:
            return [int(number) for number in self.attributes[name]]
        given = at(values, position)
        return None if given is None else [int(number) for number in given.reshape(-1).tolist()]

    def unsupported(self, what: str) -> UnsupportedError:
        """The error for a use of the operation that has no counterpart here."""
        return UnsupportedError(f"operation {self.operation} with {what} is not supported")


Values = Sequence[Tensor | None]
"""A node's inputs, None where an optional one is left out."""
Operation = Callable[[Node, Values], Tensor | Sequence[Tensor]]
"""Computes a node's outputs."""


def at(values: Values, position: int) -> Tensor | None:
    """An optional input."""
    return values[position] if position < len(values) else None


def needed(values: Values, position: int = 0) -> Tensor:
    """An input that the specification demands."""
    value = at(values, position)
    if value is None:
        raise UnsupportedError(f"input {position} is missing")
    return value
