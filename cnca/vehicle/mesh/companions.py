"""The files that a mesh is read from beside its own."""

from __future__ import annotations

import json
from pathlib import Path
from urllib.parse import unquote


def mesh_companions(path: Path) -> list[Path]:
    """The files of a ``.gltf``'s buffers that exist; all else that we read is in one file.

    An OBJ's MTL is not read (:mod:`cnca.vehicle.mesh.mesh_file`), nor are pictures that a mesh
    names.  A file that is no glTF has none: reading it as a mesh says what is wrong.
    """
    if path.suffix.lower() != ".gltf":
        return []
    try:
        buffers = json.loads(path.read_bytes())["buffers"]
        names = [unquote(buffer["uri"]) for buffer in buffers if "uri" in buffer]
    except (OSError, ValueError, KeyError, TypeError):
        return []
    return [
        path.parent / n for n in names if not n.startswith("data:") and (path.parent / n).is_file()
    ]
