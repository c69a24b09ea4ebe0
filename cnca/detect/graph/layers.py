"""Convolutions, pooling, normalization and products of matrices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor
from torch.nn import functional

from cnca.detect.graph.node import Node, Operation, Values, at, needed

CONVOLVE = {1: functional.conv1d, 2: functional.conv2d, 3: functional.conv3d}
TRANSPOSED = {
    1: functional.conv_transpose1d,
    2: functional.conv_transpose2d,
    3: functional.conv_transpose3d,
}
MAXIMUM = {1: functional.max_pool1d, 2: functional.max_pool2d, 3: functional.max_pool3d}
AVERAGE = {1: functional.avg_pool1d, 2: functional.avg_pool2d, 3: functional.avg_pool3d}


def convolution(node: Node, values: Values) -> Tensor:
    """Weights slide over the picture."""
    x, weight = needed(values, 0), needed(values, 1)
    axes = x.ndim - 2
    strides, dilations = node.get("strides", [1] * axes), node.get("dilations", [1] * axes)
    before, after = paddings(node, x.shape[2:], weight.shape[2:], strides, dilations)
    if before != after:
        x, before = functional.pad(x, torch_padding(before, after)), [0] * axes
    group = node.get("group", 1)
    bias = at(values, 2)
    return CONVOLVE[axes](x, weight, bias, tuple(strides), tuple(before), tuple(dilations), group)


def transposed_convolution(node: Node, values: Values) -> Tensor:
    """The adjoint of a convolution, by which some networks upsample."""
    x, weight = needed(values, 0), needed(values, 1)
    axes = x.ndim - 2
    pads = node.get("pads", [0] * 2 * axes)
    if node.get("auto_pad", b"NOTSET") != b"NOTSET" or "output_shape" in node.attributes:
        raise node.unsupported("a shape of its output")
    if pads[:axes] != pads[axes:]:
        raise node.unsupported("unequal padding")
    return TRANSPOSED[axes](
        x,
        weight,
        at(values, 2),
        tuple(node.get("strides", [1] * axes)),
        tuple(pads[:axes]),
        tuple(node.get("output_padding", [0] * axes)),
        node.get("group", 1),
        tuple(node.get("dilations", [1] * axes)),
    )


def max_pool(node: Node, values: Values) -> Tensor:
    """The largest value under a window."""
    x, size = needed(values), node.get("kernel_shape", [])
    axes = len(size)
    if len(node.outputs) > 1:
        raise node.unsupported("indices")
    strides, dilations = node.get("strides", [1] * axes), node.get("dilations", [1] * axes)
    before, after = paddings(node, x.shape[2:], size, strides, dilations)
    after = _rounded_up(node, x, size, strides, dilations, before, after)
    lowest = -torch.inf if x.is_floating_point() else torch.iinfo(x.dtype).min
    padded = functional.pad(x, torch_padding(before, after), value=lowest)
    return MAXIMUM[axes](padded, tuple(size), tuple(strides), 0, tuple(dilations))


def average_pool(node: Node, values: Values) -> Tensor:
    """The mean of the values under a window, with those of the padding only where asked for."""
    x, size = needed(values), node.get("kernel_shape", [])
    axes = len(size)
    strides, dilations = node.get("strides", [1] * axes), node.get("dilations", [1] * axes)
    if any(step != 1 for step in dilations):
        raise node.unsupported("dilations")
    before, after = paddings(node, x.shape[2:], size, strides, dilations)
    beyond = _rounded_up(node, x, size, strides, dilations, before, after)
    counted = torch.ones_like(x[:1, :1])
    if node.get("count_include_pad", 0):
        counted = functional.pad(counted, torch_padding(before, after), value=1.0)
        counted = functional.pad(
            counted, torch_padding([0] * axes, [b - a for a, b in zip(after, beyond, strict=True)])
        )
    else:
        counted = functional.pad(counted, torch_padding(before, beyond))
    padded = functional.pad(x, torch_padding(before, beyond))
    shape = (tuple(size), tuple(strides))
    return AVERAGE[axes](padded, *shape) / AVERAGE[axes](counted, *shape)


def batch_normalization(node: Node, values: Values) -> Tensor:
    """Normalize by the statistics of training."""
    x, scale, bias, mean, variance = (needed(values, i) for i in range(5))
    return functional.batch_norm(x, mean, variance, scale, bias, eps=node.get("epsilon", 1e-5))


def instance_normalization(node: Node, values: Values) -> Tensor:
    """Normalize by the statistics of each channel of each picture."""
    x, scale, bias = (needed(values, i) for i in range(3))
    return functional.instance_norm(x, weight=scale, bias=bias, eps=node.get("epsilon", 1e-5))


def layer_normalization(node: Node, values: Values) -> Tensor:
    """Normalize by the statistics of the last axes."""
    x, scale = needed(values, 0), needed(values, 1)
    if len(node.outputs) > 1:
        raise node.unsupported("its statistics")
    shape = x.shape[node.get("axis", -1) :]
    bias = at(values, 2)
    normal = functional.layer_norm(x, list(shape), eps=node.get("epsilon", 1e-5)) * scale
    return normal if bias is None else normal + bias


def group_normalization(node: Node, values: Values) -> Tensor:
    """Normalize by the statistics of channel groups; scales belong to channels since opset 21."""
    x, scale, bias = (needed(values, i) for i in range(3))
    groups = node.get("num_groups", 1)
    if node.opset < 21:
        scale, bias = (v.repeat_interleave(x.shape[1] // groups) for v in (scale, bias))
    return functional.group_norm(x, groups, scale, bias, eps=node.get("epsilon", 1e-5))


def gemm(node: Node, values: Values) -> Tensor:
    """α · A B + β · C, A and B transposed where asked for."""
    a, b, c = needed(values, 0), needed(values, 1), at(values, 2)
    a = a.mT if node.get("transA", 0) else a
    b = b.mT if node.get("transB", 0) else b
    product = node.get("alpha", 1.0) * (a @ b)
    return product if c is None else product + node.get("beta", 1.0) * c


def matmul(node: Node, values: Values) -> Tensor:
    """Products of matrices, further axes broadcast."""
    return needed(values, 0) @ needed(values, 1)


def einsum(node: Node, values: Values) -> Tensor:
    """A sum of products in Einstein's notation."""
    return torch.einsum(node.get("equation", b"").decode(), *[v for v in values if v is not None])


def global_average_pool(node: Node, values: Values) -> Tensor:
    """The mean of each channel."""
    x = needed(values)
    return x.mean(dim=tuple(range(2, x.ndim)), keepdim=True)


def global_max_pool(node: Node, values: Values) -> Tensor:
    """The largest value of each channel."""
    x = needed(values)
    return x.amax(dim=tuple(range(2, x.ndim)), keepdim=True)


def paddings(
    node: Node,
    inside: Sequence[int],
    size: Sequence[int],
    strides: Sequence[int],
    dilations: Sequence[int],
) -> tuple[list[int], list[int]]:
    """How many values to add before and after each axis, whose lengths are ``inside``."""
    axes, kind = len(size), node.get("auto_pad", b"NOTSET")
    pads = node.get("pads", [0] * 2 * axes)
    if kind in (b"NOTSET", b"VALID"):
        pads = pads if kind == b"NOTSET" else [0] * 2 * axes
        return list(pads[:axes]), list(pads[axes:])
    before, after = [], []
    for length, window, step, spread in zip(inside, size, strides, dilations, strict=True):
        reach = (-(-length // step) - 1) * step + (window - 1) * spread + 1
        missing = max(0, reach - length)
        upper = kind == b"SAME_UPPER"
        before.append(missing // 2 if upper else missing - missing // 2)
        after.append(missing - before[-1])
    return before, after


def torch_padding(before: Sequence[int], after: Sequence[int]) -> list[int]:
    """The paddings as torch takes them: the last axis first."""
    pairs = list(zip(before, after, strict=True))
    return [number for pair in reversed(pairs) for number in pair]


def _rounded_up(
    node: Node,
    x: Tensor,
    size: Sequence[int],
    strides: Sequence[int],
    dilations: Sequence[int],
    before: Sequence[int],
    after: Sequence[int],
) -> list[int]:
    """Padding after each axis under ``ceil_mode``; no window begins in what is added."""
    if not node.get("ceil_mode", 0):
        return list(after)
    grown = []
    axes = zip(x.shape[2:], size, strides, dilations, before, after, strict=True)
    for length, window, step, spread, first, last in axes:
        room = length + first + last - (window - 1) * spread - 1
        windows = -(-room // step) + 1
        if (windows - 1) * step >= length + first:
            windows -= 1
        grown.append(last + max(0, (windows - 1) * step - room))
    return grown


OPERATIONS: Mapping[str, Operation] = {
    "AveragePool": average_pool,
    "BatchNormalization": batch_normalization,
    "Conv": convolution,
    "ConvTranspose": transposed_convolution,
    "Einsum": einsum,
    "Gemm": gemm,
    "GlobalAveragePool": global_average_pool,
    "GlobalMaxPool": global_max_pool,
    "GroupNormalization": group_normalization,
    "InstanceNormalization": instance_normalization,
    "LayerNormalization": layer_normalization,
    "MatMul": matmul,
    "MaxPool": max_pool,
}
