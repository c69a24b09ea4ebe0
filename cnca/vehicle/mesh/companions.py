"""The files that a mesh is read from besides its own."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

from cnca.core.text import decode_names
from cnca.vehicle.mesh.finder import Finder
from cnca.vehicle.mesh.mtl import material_library, pictures_of


def mesh_companions(path: Path) -> list[Path]:
    """The existing files among those that a ``.gltf`` or ``.obj`` names; other kinds name none.

    A file that is not of its kind has none: reading it as a mesh says what is wrong.
    """
    names = {".gltf": _named_by_gltf, ".obj": _named_by_obj}.get(path.suffix.lower())
    if names is None:
        return []
    finder = Finder(path)
    for name in names(path, finder):
        _find(finder, name)
    return finder.files[1:]


def _named_by_gltf(path: Path, finder: Finder) -> Iterator[str]:  # noqa: ARG001
    try:
        content = json.loads(path.read_bytes())
        entries = [*content["buffers"], *content.get("images", [])]
        uris = [entry["uri"] for entry in entries if "uri" in entry]
    except (OSError, ValueError, KeyError, TypeError):
        return
    yield from (unquote(uri) for uri in uris if not uri.startswith("data:"))


def _named_by_obj(path: Path, finder: Finder) -> Iterator[str]:
    try:
        lines = decode_names(path.read_bytes()).split("\n")
    except OSError:
        return
    rests = [line.split(None, 1)[1] for line in lines if line.startswith("mtllib") and " " in line]
    for library in (name for rest in rests for name in material_library(rest.strip())):
        if data := _find(finder, library):
            yield from pictures_of(decode_names(data))


def _find(finder: Finder, name: str) -> bytes:
    """The bytes of a file that is named, which the finder remembers; none where it is missing."""
    try:
        return finder.get(name)
    except (OSError, ValueError):
        return b""
