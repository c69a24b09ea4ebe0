"""Operations along whole axes: sums, extremes, softmax, sorting; and sampling at given places."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import torch
from torch import Tensor
from torch.nn import functional

from cnca.detect.graph.node import Node, Operation, Values, needed

Reduce = Callable[[Tensor, tuple[int, ...], bool], Tensor]


def reduction(function: Reduce) -> Operation:
    """An operation over ``axes``, all of them where none are given."""

    def reduced(node: Node, values: Values) -> Tensor:
        x, axes = needed(values), node.numbers("axes", values, 1)
        if not axes:
            if node.get("noop_with_empty_axes", 0):
                return x
            axes = list(range(x.ndim))
        return function(x, tuple(axes), bool(node.get("keepdims", 1)))

    return reduced


def product(x: Tensor, axes: tuple[int, ...], keep: bool) -> Tensor:
    """The product, one axis after the other."""
    for axis in sorted((axis % x.ndim for axis in axes), reverse=True):
        x = x.prod(dim=axis, keepdim=keep)
    return x


def extreme(function: Callable[..., Tensor]) -> Operation:
    """Where the largest or smallest value stands; the first of equals."""

    def place(node: Node, values: Values) -> Tensor:
        if node.get("select_last_index", 0):
            raise node.unsupported("the last of equals")
        axis, keep = node.get("axis", 0), bool(node.get("keepdims", 1))
        return function(needed(values), dim=axis, keepdim=keep)

    return place


def top(node: Node, values: Values) -> Sequence[Tensor]:
    """The k largest (or smallest) values, sorted, and where they stand."""
    x, count = needed(values), (node.numbers("k", values, 1) if "k" not in node.attributes else [])
    k = count[0] if count else node.get("k", 1)
    largest = bool(node.get("largest", 1))
    # A stable sort: equals keep their order, as ONNX demands and torch.topk does not promise.
    found = x.sort(dim=node.get("axis", -1), descending=largest, stable=True)
    axis = node.get("axis", -1)
    return found.values.narrow(axis, 0, k), found.indices.narrow(axis, 0, k)


def softmax(node: Node, values: Values) -> Tensor:
    """Softmax over one axis; before opset 13 over all from ``axis`` on."""
    return _over_axes(node, needed(values), torch.softmax)


def log_softmax(node: Node, values: Values) -> Tensor:
    """The logarithm of softmax."""
    return _over_axes(node, needed(values), torch.log_softmax)


def _over_axes(node: Node, x: Tensor, function: Callable[..., Tensor]) -> Tensor:
    if node.opset >= 13:
        return function(x, dim=node.get("axis", -1))
    axis = node.get("axis", 1) % x.ndim
    return function(x.flatten(axis), dim=-1).reshape(x.shape)


def cumulative_sum(node: Node, values: Values) -> Tensor:
    """Running sums along an axis."""
    if node.get("exclusive", 0) or node.get("reverse", 0):
        raise node.unsupported("exclusive or reverse")
    return needed(values).cumsum(dim=int(needed(values, 1).item()))


def grid_sample(node: Node, values: Values) -> Tensor:
    """Values of a picture at places between its pixels."""
    mode = node.get("mode", b"linear").decode()
    mode = {"linear": "bilinear", "cubic": "bicubic"}.get(mode, mode)
    return functional.grid_sample(
        needed(values, 0),
        needed(values, 1),
        mode=mode,
        padding_mode=node.get("padding_mode", b"zeros").decode(),
        align_corners=bool(node.get("align_corners", 0)),
    )


OPERATIONS: Mapping[str, Operation] = {
    "ArgMax": extreme(torch.argmax),
    "ArgMin": extreme(torch.argmin),
    "CumSum": cumulative_sum,
    "GridSample": grid_sample,
    "LogSoftmax": log_softmax,
    "ReduceL1": reduction(lambda x, axes, keep: x.abs().sum(axes, keepdim=keep)),
    "ReduceL2": reduction(lambda x, axes, keep: x.square().sum(axes, keepdim=keep).sqrt()),
    "ReduceMax": reduction(lambda x, axes, keep: x.amax(axes, keepdim=keep)),
    "ReduceMean": reduction(lambda x, axes, keep: x.mean(axes, keepdim=keep)),
    "ReduceMin": reduction(lambda x, axes, keep: x.amin(axes, keepdim=keep)),
    "ReduceProd": reduction(product),
    "ReduceSum": reduction(lambda x, axes, keep: x.sum(axes, keepdim=keep).to(x.dtype)),
    "Softmax": softmax,
    "TopK": top,
}
