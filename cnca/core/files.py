"""Files that are written whole or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cnca.core.errors import RunError

UNFINISHED = ".writing-"
"""How the names of temporary folders begin."""


@contextmanager
def _explained(path: str | Path) -> Iterator[None]:
    """Turns the system's refusal to write ``path`` into a RunError."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or error
        raise RunError(f"{path}: cannot be written ({reason}); check disk and folder") from error


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Yield a temporary name beside ``path`` to write to; rename it to ``path`` when that is done.

    Makes missing folders.  After an exception the temporary file is gone and ``path`` unchanged.
    Raises RunError if the folder cannot be written.
    """
    path = Path(path)
    with _explained(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        # A folder, since writers want to make the file themselves and look at its extension.
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=UNFINISHED) as folder:
            temporary = Path(folder) / path.name
            yield temporary
            os.replace(temporary, path)


def append_text(path: str | Path, text: str) -> None:
    """Add UTF-8 text to the end of a file; raises RunError if it cannot be written."""
    with _explained(path), Path(path).open("a", encoding="utf-8") as file:
        file.write(text)


def remove_unfinished(folder: Path) -> None:
    """Remove what :func:`replacing` left in ``folder`` when its process was killed."""
    for leftover in folder.glob(f"{UNFINISHED}*"):
        shutil.rmtree(leftover, ignore_errors=True)


def write_text(path: str | Path, text: str) -> None:
    """Write UTF-8 text whole or not at all."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
