"""Whether a graph in torch computes what ONNX Runtime computes."""

from __future__ import annotations

from collections.abc import Mapping

import onnx
import torch
from torch import Tensor

from cnca.detect.graph.network import OnnxNetwork
from cnca.detect.graph.node import UnsupportedError

TOLERANCE, HALF_TOLERANCE = 1e-4, 1e-2
"""Of outputs, both absolute and relative; the second one for weights in half precision."""


class NoGradientError(ValueError):
    """The graph cannot be attacked; says why."""


def white_box(
    model: onnx.ModelProto,
    inputs: Mapping[str, Tensor],
    picture: str,
    expected: Mapping[str, Tensor],
) -> OnnxNetwork:
    """The graph as a torch module whose outputs for ``inputs`` are the ``expected`` ones.

    Args:
        inputs: all inputs by name.
        picture: which of them is to have a gradient.
        expected: outputs by name, as ONNX Runtime computes them.

    Raises:
        NoGradientError: an operation is unknown, the outputs differ, or have no gradient.
    """
    leaf = inputs[picture].detach().requires_grad_()
    try:
        network = OnnxNetwork(model)
        found = network({**inputs, picture: leaf})
    except UnsupportedError as error:
        raise NoGradientError(str(error)) from error
    except Exception as error:  # whatever torch raises for a graph that means something else
        raise NoGradientError(f"torch cannot compute it ({error})") from error
    tolerance = HALF_TOLERANCE if _is_half(model) else TOLERANCE
    for name, values in expected.items():
        problem = _difference(found[name].detach(), values, tolerance)
        if problem:
            raise NoGradientError(f"output '{name}' {problem}")
    if not any(found[name].requires_grad for name in expected):
        raise NoGradientError("its outputs do not follow from the picture by a gradient")
    return network


def _difference(found: Tensor, expected: Tensor, tolerance: float) -> str:
    """What is wrong with an output, or ""."""
    if found.shape != expected.shape:
        return f"has shape {tuple(found.shape)} in torch, {tuple(expected.shape)} in ONNX Runtime"
    if torch.allclose(found.double(), expected.double(), rtol=tolerance, atol=tolerance):
        return ""
    worst = (found.double() - expected.double()).abs().max().item()
    return f"differs by {worst:.2g} between torch and ONNX Runtime"


def _is_half(model: onnx.ModelProto) -> bool:
    half = onnx.TensorProto.FLOAT16
    return any(entry.data_type == half for entry in model.graph.initializer)
