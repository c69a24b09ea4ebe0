"""Resizing by ONNX's rules, which torch's own function covers only in part.

Each axis is resized on its own: every value of the output is a weighted sum of a few *taps* of the
input (1: nearest, 2: linear, 4: cubic; Keys 1981 for the last).
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from jaxtyping import Float, Int
from torch import Tensor

from cnca.detect.graph.node import Node, Operation, Values, at, needed

Places = Float[Tensor, " length"]
"""Where the values of the output lie in the input, in its cells."""
Taps = tuple[Int[Tensor, "length taps"], Float[Tensor, "length taps"]]
"""Cells of the input, and their weights."""


def resize(node: Node, values: Values) -> Tensor:
    """Scale some axes of a tensor."""
    x = needed(values)
    for name in ("antialias", "exclude_outside"):
        if node.get(name, 0):
            raise node.unsupported(name)
    if node.get("keep_aspect_ratio_policy", b"stretch") != b"stretch":
        raise node.unsupported("a kept aspect ratio")
    axes = [axis % x.ndim for axis in node.get("axes", range(x.ndim))]
    for axis, (length, scale) in zip(axes, _targets(node, values, axes), strict=True):
        if length != x.shape[axis] or scale != 1:
            places = _places(node, x.shape[axis], length, scale).to(x.device)
            x = _gather(x, axis, _taps(node, places))
    return x


def _targets(node: Node, values: Values, axes: list[int]) -> list[tuple[int, float]]:
    """The new length and scale of each axis, from scales or from sizes."""
    x = needed(values)
    if node.operation == "Upsample":
        scales = node.get("scales", None)
        given = needed(values, 1).tolist() if scales is None else scales
        return [(int(x.shape[axis] * s), float(s)) for axis, s in zip(axes, given, strict=True)]
    numbers = at(values, 1 if node.opset < 11 else 2)
    sizes = at(values, 3)
    if sizes is not None and sizes.numel():
        lengths = [int(size) for size in sizes.tolist()]
        return [(n, n / x.shape[axis]) for axis, n in zip(axes, lengths, strict=True)]
    if numbers is None:
        raise node.unsupported("neither scales nor sizes")
    return [
        (int(x.shape[axis] * scale), float(scale))
        for axis, scale in zip(axes, numbers.tolist(), strict=True)
    ]


def _places(node: Node, before: int, after: int, scale: float) -> Places:
    """ONNX's ``coordinate_transformation_mode``."""
    usual = b"half_pixel" if node.operation == "Resize" and node.opset >= 11 else b"asymmetric"
    mode = node.get("coordinate_transformation_mode", usual)
    index = torch.arange(after, dtype=torch.float64)
    match mode:
        case b"asymmetric":
            return index / scale
        case b"half_pixel":
            return (index + 0.5) / scale - 0.5
        case b"pytorch_half_pixel":
            return (index + 0.5) / scale - 0.5 if after > 1 else torch.zeros_like(index)
        case b"align_corners":
            # By the rounded length, as ONNX Runtime does.
            return index * ((before - 1) / max(after - 1, 1))
        case b"half_pixel_symmetric":
            centre = before / 2 * (1 - after / (scale * before))
            return centre + (index + 0.5) / scale - 0.5
        case _:
            raise node.unsupported(f"coordinates by '{mode.decode()}'")


def _taps(node: Node, places: Places) -> Taps:
    """ONNX's ``mode``."""
    mode = node.get("mode", b"nearest")
    floor = places.floor()
    part = (places - floor)[:, None]
    if mode == b"nearest":
        return _nearest(node, places)[:, None].long(), torch.ones_like(part)
    first = floor.long()[:, None]
    if mode in (b"linear", b"bilinear"):
        return first + torch.arange(2).to(first), torch.cat([1 - part, part], dim=1)
    if mode == b"cubic":
        distances = (part - torch.arange(-1, 3).to(part)).abs()
        return first + torch.arange(-1, 3).to(first), _cubic(distances, node)
    raise node.unsupported(f"mode '{mode.decode()}'")


def _nearest(node: Node, places: Places) -> Places:
    """ONNX's ``nearest_mode``."""
    old = node.operation == "Upsample" or node.opset < 11
    match node.get("nearest_mode", b"floor" if old else b"round_prefer_floor"):
        case b"floor":
            return places.floor()
        case b"ceil":
            return places.ceil()
        case b"round_prefer_ceil":
            return (places + 0.5).floor()
        case _:
            return (places - 0.5).ceil()


def _cubic(distances: Float[Tensor, "length 4"], node: Node) -> Float[Tensor, "length 4"]:
    """Weights of four taps by their distances in [0, 2]."""
    a = node.get("cubic_coeff_a", -0.75)
    near = ((a + 2) * distances - (a + 3)) * distances**2 + 1
    far = a * (((distances - 5) * distances + 8) * distances - 4)
    return torch.where(distances <= 1, near, far)


def _gather(x: Tensor, axis: int, taps: Taps) -> Tensor:
    """Weighted sums of the taps; those outside repeat the border."""
    cells, weights = taps
    cells = cells.clamp(0, x.shape[axis] - 1)
    shape = [-1 if i == axis else 1 for i in range(x.ndim)]
    return sum(
        (
            x.index_select(axis, cells[:, i]) * weights[:, i].to(x.dtype).reshape(shape)
            for i in range(cells.shape[1])
        ),
        start=x.new_zeros(()),
    )


OPERATIONS: Mapping[str, Operation] = {"Resize": resize, "Upsample": resize}
