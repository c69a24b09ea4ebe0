"""What a run was made from: versions, configuration, seeds, and hashes of everything it read."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Iterable, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from cnca.core.errors import RunError
from cnca.core.files import replacing
from cnca.core.version import VERSION

PACKAGES = ("mitsuba", "drjit", "torch", "diffusers", "transformers", "numpy", "scipy", "trimesh")


def versions() -> dict[str, str]:
    """Version of CNCA, Python and the packages that can change a result."""
    found = {"cnca": VERSION, "python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "missing"
    return found


def hashes(paths: Iterable[Path]) -> dict[str, str]:
    """SHA-256 of each file; a folder stands for all files in it."""
    table = {}
    for path in sorted(set(paths)):
        files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
        for file in files:
            table[str(file)] = hashlib.sha256(file.read_bytes()).hexdigest()
    return table


def read_json(path: Path) -> dict[str, Any]:
    """What :func:`write_json` wrote; raises RunError where that cannot be read."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise RunError(f"{path}: damaged ({error}); delete it to begin this run anew") from None


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write JSON whole or not at all; NaN and infinity are refused."""
    text = json.dumps(content, indent=2, allow_nan=False, default=str) + "\n"
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
