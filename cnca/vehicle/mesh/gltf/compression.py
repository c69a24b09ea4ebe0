"""Compressed glTF: Draco by DracoPy, meshopt by meshopt, where these are installed."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from types import ModuleType
from typing import Any

import numpy as np
from jaxtyping import Int, Num

from cnca.core.errors import MeshError

DRACO = "KHR_draco_mesh_compression"
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
MOST_BYTES = 1 << 30


def unpack_view(packed: bytes, extension: Mapping[str, Any], name: str) -> bytes:
    """The bytes of a buffer view that meshopt compressed; raises MeshError for damaged ones."""
    meshopt = _library("meshopt", name)
    count, stride = int(extension["count"]), int(extension["byteStride"])
    if not 0 < count * stride <= MOST_BYTES:
        raise ValueError(f"{name}: {count} entries of {stride} bytes")
    mode, how = str(extension["mode"]), str(extension.get("filter", "NONE"))
    try:
        rows = meshopt.decode_gltf_buffer(packed, count, stride, mode, how)
    except Exception as error:  # whatever the binding raises, the data are not what they claim
        raise MeshError(f"{name}: its data cannot be decoded ({error})") from None
    return bytes(np.ascontiguousarray(rows).tobytes())


def unpack_primitive(
    packed: bytes, names: Mapping[str, int]
) -> tuple[dict[str, Num[np.ndarray, "count width"]], Int[np.ndarray, " corners"]]:
    """The attributes and the corners of the triangles of a primitive that Draco compressed.

    ``names`` gives each attribute's number in the packed data.
    """
    draco = _library("DracoPy", DRACO)
    try:
        mesh = draco.decode(packed)
        attributes = {
            name: np.asarray(mesh.get_attribute_by_unique_id(number)["data"])
            for name, number in names.items()
        }
        corners = np.asarray(mesh.faces, np.int64).reshape(-1)
    except Exception as error:  # as above
        raise MeshError(f"{DRACO}: its data cannot be decoded ({error})") from None
    return {n: a.reshape(len(a), -1) for n, a in attributes.items()}, corners


def _library(module: str, extension: str) -> ModuleType:
    try:
        return importlib.import_module(module)
    except ImportError:
        raise MeshError(
            f"{extension}: is read with the package {module}; pip install {module}, "
            "or export without compression"
        ) from None
