"""What a run was made from: versions, what was asked for, and hashes of everything it read."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, is_dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from cnca.core.errors import RunError
from cnca.core.files import replacing
from cnca.core.version import VERSION

PACKAGES = ("mitsuba", "drjit", "torch", "diffusers", "transformers", "numpy", "scipy", "trimesh")
PACKAGE = Path(__file__).parents[1]
DRAWING = (
    *("core", "scene", "vehicle", "world", "effects", "mi_bridge", "build.py"),
    "assets/prices.json",
)
"""Parts of the package that decide what a picture of a scene looks like."""
DETECTING, PAINTING = ("core", "detect"), ("core", "gen")
"""Those that decide what a detector reports, and what a generator paints."""


@dataclass(frozen=True)
class Manifest:
    """The content of ``manifest.json``."""

    job: str
    """The command, such as ``optimize``; empty where the file is older than this field."""
    request: dict[str, Any]
    """Everything that was asked for and decides the result, as JSON has it."""
    versions: dict[str, str]
    inputs: dict[str, str]
    """File → SHA-256."""

    @staticmethod
    def of(job: str, request: object, inputs: Mapping[str, str]) -> Manifest:
        """The manifest of what begins now; ``request`` is a mapping or a dataclass."""
        return Manifest(job, plain(request), versions(), dict(inputs))

    @staticmethod
    def read(path: Path) -> Manifest:
        """What :meth:`write` wrote; raises RunError where that cannot be read."""
        content = read_json(path)
        try:
            parts = [dict(content[key]) for key in ("request", "versions", "inputs")]
            return Manifest(str(content.get("job", "")), *parts)
        except (KeyError, TypeError, ValueError, AttributeError):
            raise RunError(f"{path}: not the manifest of a run; choose another folder") from None

    def write(self, path: Path) -> None:
        """Write it whole or not at all."""
        write_json(path, asdict(self))

    def other_versions(self) -> dict[str, tuple[str, str]]:
        """Package → its version then and now, where they differ."""
        now = versions()
        return {
            name: (then, now.get(name, "missing"))
            for name, then in self.versions.items()
            if then != now.get(name, "missing")
        }


def plain(request: object) -> dict[str, Any]:
    """A dataclass or mapping as it comes back from a JSON file; paths become text."""
    fields = asdict(request) if is_dataclass(request) else request  # type: ignore[arg-type]
    return json.loads(json.dumps(fields, default=str))


def versions() -> dict[str, str]:
    """Version of CNCA, Python and the packages that can change a result."""
    table = {"cnca": VERSION, "python": platform.python_version()}
    for package in PACKAGES:
        try:
            table[package] = version(package)
        except PackageNotFoundError:
            table[package] = "missing"
    return table


def hashes(paths: Iterable[Path]) -> dict[str, str]:
    """SHA-256 of each file; a folder stands for all files in it.

    Raises RunError for a file that cannot be read.
    """
    table = {}
    for path in sorted(set(paths)):
        files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
        for file in files:
            try:
                with file.open("rb") as content:
                    table[str(file)] = hashlib.file_digest(content, "sha256").hexdigest()
            except OSError as error:
                raise RunError(
                    f"{file}: cannot be read ({error.strerror}); bring it back"
                ) from None
    return table


@cache
def program(*parts: str) -> str:
    """Stands for the code in these parts of the package, and for the versions of what it uses.

    By the content of the sources: so a picture from before a change of them is never taken for one
    from after it, whether or not the version was counted up in between.
    """
    state = hashlib.sha256(json.dumps(versions()).encode())
    for part in parts:
        path = PACKAGE / part
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            state.update(file.relative_to(PACKAGE).as_posix().encode())
            state.update(file.read_bytes())
    return state.hexdigest()


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
