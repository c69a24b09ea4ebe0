"""The one reader of accessors: normalized, sparse, quantized, interleaved and compressed ones.

Source: Khronos, "glTF 2.0 Specification", section 3.6.2.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Num

from cnca.vehicle.mesh.gltf import compression
from cnca.vehicle.mesh.gltf.container import Container, Entry

COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
MOST = 50_000_000
"""Entries of an accessor; a number in the file can promise any."""


def read_accessor(file: Container, index: int) -> Num[np.ndarray, "count width"]:
    """Its values: floats where they are floats or normalized, else whole numbers.

    Raises ValueError, KeyError, IndexError or TypeError for one that is damaged.
    """
    accessor = file.entries("accessors")[index]
    kind, width = _form(accessor)
    count = int(accessor["count"])
    if not 0 <= count <= MOST:
        raise ValueError(f"accessor {index} has {count} entries")
    if "bufferView" in accessor:
        start = int(accessor.get("byteOffset", 0))
        values = _view(file, accessor["bufferView"], start, count, kind, width)
    else:
        values = np.zeros((count, width), kind)
    if sparse := accessor.get("sparse"):
        values = values.copy()
        number, places, new = int(sparse["count"]), sparse["indices"], sparse["values"]
        at = _view(file, places["bufferView"], int(places.get("byteOffset", 0)), number,
                   np.dtype(COMPONENTS[places["componentType"]]), 1)  # fmt: skip
        start = int(new.get("byteOffset", 0))
        values[at[:, 0]] = _view(file, new["bufferView"], start, number, kind, width)
    return as_numbers(values, normalized=bool(accessor.get("normalized")))


def as_numbers(
    values: Num[np.ndarray, "count width"], *, normalized: bool
) -> Num[np.ndarray, "count width"]:
    """Normalized whole numbers stand for [0, 1], or for [-1, 1] where they have a sign."""
    if not np.issubdtype(values.dtype, np.integer):
        return values.astype(np.float64)
    if not normalized:
        return values.astype(np.int64)
    return np.maximum(values / np.iinfo(values.dtype).max, -1.0)


def _form(accessor: Entry) -> tuple[np.dtype[Any], int]:
    return np.dtype(COMPONENTS[accessor["componentType"]]), WIDTHS[accessor["type"]]


def _view(
    file: Container, index: int, start: int, count: int, kind: np.dtype[Any], width: int
) -> Num[np.ndarray, "count width"]:
    """``count`` rows of ``width`` numbers of a buffer view, from the byte ``start`` on."""
    view = file.entries("bufferViews")[index]
    data = view_bytes(file, index)
    stride = int(view.get("byteStride") or kind.itemsize * width)
    if start < 0 or stride < 0 or (count and start + stride * (count - 1) + kind.itemsize * width > len(data)):  # fmt: skip  # noqa: E501
        raise ValueError(f"buffer view {index} ends before its last entry")
    if not count:
        return np.zeros((0, width), kind)
    rows = np.ndarray((count, width), kind, data, start, (stride, kind.itemsize))
    return rows.copy()


def view_bytes(file: Container, index: int) -> bytes:
    """The bytes of a buffer view, decompressed where it is compressed."""
    view = file.entries("bufferViews")[index]
    for name in compression.MESHOPT:
        if packed := view.get("extensions", {}).get(name):
            return compression.unpack_view(_slice(file, packed), packed, name)
    return _slice(file, view)


def _slice(file: Container, view: Entry) -> bytes:
    start, length = int(view.get("byteOffset", 0)), int(view["byteLength"])
    data = file.buffer(view["buffer"])
    if start < 0 or length < 0 or start + length > len(data):
        raise ValueError("a buffer view reaches beyond its buffer")
    return data[start : start + length]
