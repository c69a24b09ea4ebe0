"""Operations that move values, and those that compute shapes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor
from torch.nn import functional

from cnca.detect.graph.layers import torch_padding
from cnca.detect.graph.node import TENSOR_TYPES, Node, Operation, Values, at, needed

PADDING = {
    b"constant": "constant",
    b"reflect": "reflect",
    b"edge": "replicate",
    b"wrap": "circular",
}
"""ONNX's names and torch's."""


def whole(values: Values, position: int) -> list[int]:
    """An input that holds a shape, axes or places."""
    return [int(number) for number in needed(values, position).reshape(-1).tolist()]


def reshape(node: Node, values: Values) -> Tensor:
    """The same values in another shape; 0 keeps a length, −1 is what is left."""
    x = needed(values)
    shape = node.numbers("shape", values, 1) or []
    if not node.get("allowzero", 0):
        shape = [x.shape[i] if length == 0 else length for i, length in enumerate(shape)]
    return torch.reshape(x, tuple(shape))


def flatten(node: Node, values: Values) -> Tensor:
    """Two axes: those before ``axis``, and the others."""
    x, axis = needed(values), node.get("axis", 1)
    rows = x.shape[:axis].numel() if axis else 1
    return x.reshape(rows, -1)


def transpose(node: Node, values: Values) -> Tensor:
    """Axes in another order, by default reversed."""
    x = needed(values)
    return x.permute(node.get("perm", list(range(x.ndim))[::-1]))


def squeeze(node: Node, values: Values) -> Tensor:
    """The tensor without axes of length 1."""
    axes = node.numbers("axes", values, 1)
    return needed(values).squeeze() if axes is None else needed(values).squeeze(tuple(axes))


def unsqueeze(node: Node, values: Values) -> Tensor:
    """The tensor with further axes of length 1."""
    x, axes = needed(values), node.numbers("axes", values, 1) or []
    rank = x.ndim + len(axes)
    for axis in sorted(axis % rank for axis in axes):
        x = x.unsqueeze(axis)
    return x


def concatenate(node: Node, values: Values) -> Tensor:
    """One tensor after the other along an axis."""
    return torch.cat([v for v in values if v is not None], dim=node.get("axis", 0))


def split(node: Node, values: Values) -> Sequence[Tensor]:
    """Parts of an axis, of given lengths or as equal as can be."""
    x, axis = needed(values), node.get("axis", 0)
    lengths = node.numbers("split", values, 1)
    if lengths is None:
        longest = -(-x.shape[axis] // len(node.outputs))
        return x.split(longest, dim=axis)
    return x.split(lengths, dim=axis)


def cut(node: Node, values: Values) -> Tensor:
    """``Slice``: from starts to ends by steps, some of which may run backwards."""
    x = needed(values)
    starts, ends = node.numbers("starts", values, 1), node.numbers("ends", values, 2)
    if starts is None or ends is None:
        raise node.unsupported("no starts or ends")
    axes = node.numbers("axes", values, 3) or list(range(len(starts)))
    steps = (whole(values, 4) if at(values, 4) is not None else None) or [1] * len(starts)
    for start, end, axis, step in zip(starts, ends, axes, steps, strict=True):
        places = range(x.shape[axis])[slice(start, _end(end, x.shape[axis], step), step)]
        if step == 1:
            x = x.narrow(axis, places.start, len(places))
        else:
            x = x.index_select(axis, torch.tensor(list(places), dtype=torch.long, device=x.device))
    return x


def _end(end: int, length: int, step: int) -> int | None:
    """Python's end: −1 − length and below mean before the first value where steps run backwards."""
    return None if step < 0 and end < -length else end


def gather(node: Node, values: Values) -> Tensor:
    """Slices of an axis by their numbers."""
    x, indices, axis = needed(values, 0), needed(values, 1), node.get("axis", 0)
    axis %= x.ndim
    flat = indices.reshape(-1).long() % x.shape[axis]
    picked = x.index_select(axis, flat.to(x.device))
    return picked.reshape((*x.shape[:axis], *indices.shape, *x.shape[axis + 1 :]))


def gather_elements(node: Node, values: Values) -> Tensor:
    """Single values along an axis by their numbers."""
    x, indices, axis = needed(values, 0), needed(values, 1).long(), node.get("axis", 0)
    return x.gather(axis, indices % x.shape[axis])


def gather_nd(node: Node, values: Values) -> Tensor:
    """Slices by numbers along the first axes."""
    x, indices = needed(values, 0), needed(values, 1).long()
    if node.get("batch_dims", 0):
        raise node.unsupported("batch_dims")
    return x[tuple(indices.unbind(-1))]


def scatter_nd(node: Node, values: Values) -> Tensor:
    """A copy in which slices are replaced."""
    if node.get("reduction", b"none") != b"none":
        raise node.unsupported("a reduction")
    indices = needed(values, 1).long()
    return needed(values, 0).index_put(tuple(indices.unbind(-1)), needed(values, 2))


def scatter_elements(node: Node, values: Values) -> Tensor:
    """A copy in which single values along an axis are replaced."""
    if node.get("reduction", b"none") != b"none":
        raise node.unsupported("a reduction")
    x, indices, axis = needed(values, 0), needed(values, 1).long(), node.get("axis", 0)
    return x.scatter(axis, indices % x.shape[axis], needed(values, 2))


def expand(node: Node, values: Values) -> Tensor:
    """Broadcast; a length of 1 keeps that of the input."""
    x = needed(values)
    shape = torch.broadcast_shapes(x.shape, whole(values, 1))
    return x.expand(shape)


def tile(node: Node, values: Values) -> Tensor:
    """The tensor repeated along each axis."""
    return needed(values).repeat(whole(values, 1))


def pad(node: Node, values: Values) -> Tensor:
    """Values added before and after axes; negative numbers take some away."""
    x, kind = needed(values), node.get("mode", b"constant")
    pads = node.numbers("pads", values, 1) or []
    filled = at(values, 2)
    value = node.get("value", 0.0) if filled is None else filled.item()
    axes = whole(values, 3) if at(values, 3) is not None else list(range(x.ndim))
    before, after = [0] * x.ndim, [0] * x.ndim
    for i, axis in enumerate(axes):
        before[axis], after[axis] = pads[i], pads[i + len(axes)]
    if kind == b"constant":
        return functional.pad(x, torch_padding(before, after), value=value)
    if any(before[:2] + after[:2]) or x.ndim < 3:
        raise node.unsupported(f"mode '{kind.decode()}' along the first two axes")
    return functional.pad(x, torch_padding(before[2:], after[2:]), mode=PADDING[kind])


def shape_of(node: Node, values: Values) -> Tensor:
    """The lengths of the axes."""
    shape = list(needed(values).shape)[node.get("start", 0) : node.get("end", None)]
    return torch.tensor(shape, dtype=torch.int64)


def size_of(node: Node, values: Values) -> Tensor:
    """How many values there are."""
    return torch.tensor(needed(values).numel())


def constant_of_shape(node: Node, values: Values) -> Tensor:
    """One value everywhere."""
    value = node.get("value", torch.zeros(1))
    return torch.full(whole(values, 0), value.item(), dtype=value.dtype)


def counting(node: Node, values: Values) -> Tensor:
    """``Range``: numbers from a start to before an end by steps."""
    start, end, step = (needed(values, i) for i in range(3))
    return torch.arange(start.item(), end.item(), step.item(), dtype=start.dtype)


def cast(node: Node, values: Values) -> Tensor:
    """The values as another type of number."""
    kind = TENSOR_TYPES.get(node.get("to", 0))
    if kind is None:
        raise node.unsupported(f"type {node.get('to', 0)}")
    return needed(values).to(kind)


def cast_like(node: Node, values: Values) -> Tensor:
    """The values in the type of another tensor."""
    return needed(values, 0).to(needed(values, 1).dtype)


def depth_to_space(node: Node, values: Values) -> Tensor:
    """Channels become blocks of pixels."""
    x, block = needed(values), node.get("blocksize", 1)
    if node.get("mode", b"DCR") == b"CRD":
        return functional.pixel_shuffle(x, block)
    batch, channels, rows, columns = x.shape
    blocks = x.reshape(batch, block, block, channels // block**2, rows, columns)
    return blocks.permute(0, 3, 4, 1, 5, 2).reshape(batch, -1, rows * block, columns * block)


def space_to_depth(node: Node, values: Values) -> Tensor:
    """Blocks of pixels become channels."""
    x, block = needed(values), node.get("blocksize", 1)
    if node.get("mode", b"DCR") == b"CRD":
        return functional.pixel_unshuffle(x, block)
    batch, channels, rows, columns = x.shape
    blocks = x.reshape(batch, channels, rows // block, block, columns // block, block)
    return blocks.permute(0, 3, 5, 1, 2, 4).reshape(batch, -1, rows // block, columns // block)


def nonzero(node: Node, values: Values) -> Tensor:
    """Where values are not 0, one row per axis."""
    return needed(values).nonzero().mT


OPERATIONS: Mapping[str, Operation] = {
    "Cast": cast,
    "CastLike": cast_like,
    "Concat": concatenate,
    "ConstantOfShape": constant_of_shape,
    "DepthToSpace": depth_to_space,
    "Expand": expand,
    "Flatten": flatten,
    "Gather": gather,
    "GatherElements": gather_elements,
    "GatherND": gather_nd,
    "NonZero": nonzero,
    "Pad": pad,
    "Range": counting,
    "Reshape": reshape,
    "ScatterElements": scatter_elements,
    "ScatterND": scatter_nd,
    "Shape": shape_of,
    "Size": size_of,
    "Slice": cut,
    "SpaceToDepth": space_to_depth,
    "Split": split,
    "Squeeze": squeeze,
    "Tile": tile,
    "Transpose": transpose,
    "Unsqueeze": unsqueeze,
}
