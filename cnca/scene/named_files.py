"""The files that a scene names, found without a list of the keys that may name one."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from cnca.scene.schema import Scene


def named_files(scene: Scene) -> list[Path]:
    """Every file that any value of the scene names, in the order of its keys.

    Looked for among all texts of the record: a key that is added to the schema is never forgotten
    in a manifest or in the key of kept pictures.  A text that only happens to be the name of a file
    is one file too many, which does no harm.
    """
    paths = (scene.base / text for text in _texts(scene.model_dump()) if text.strip(". "))
    return list(dict.fromkeys(path for path in paths if _exists(path)))


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for inner in value.values():
            yield from _texts(inner)
    elif isinstance(value, list | tuple):
        for inner in value:
            yield from _texts(inner)


def _exists(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # a text that no system takes for a name, such as a long one
        return False
