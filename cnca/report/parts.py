"""From the files of a run's folder to the parts of its report."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from cnca.core.errors import RunError
from cnca.core.manifest import Manifest
from cnca.report.attack import attack_parts
from cnca.report.blocks import Details, Gallery, Part, Picture, Prose
from cnca.report.comparison import TITLES, comparison_parts
from cnca.report.evidence import evidence_parts
from cnca.report.markdown import as_html
from cnca.report.tables import table
from cnca.report.webpage import file_uri

Reader = Callable[[Path], list[Part]]
"""Takes the file that a finished command leaves."""


def read_parts(folder: Path) -> list[Part]:
    """All that the folder holds, the most telling part first.

    Raises:
        RunError: it holds no finished run, or one whose files are damaged.
    """
    names = [name for name in READERS if (folder / name).is_file()]
    if not names:
        raise RunError(
            f"{folder}: holds no finished run (none of {', '.join(READERS)}); "
            "give the --out of a command that has ended"
        )
    parts = [part for name in names for part in _read(folder / name, READERS[name])]
    if (folder / "manifest.json").is_file():
        parts += _read(folder / "manifest.json", _manifest)
    return parts


def _read(path: Path, reader: Reader) -> list[Part]:
    try:
        return reader(path)
    except (OSError, ValueError, KeyError, TypeError, IndexError, AttributeError) as error:
        reason = f"{type(error).__name__}: {error}"
        raise RunError(f"{path}: damaged or not complete ({reason}); run it again") from error


def _prices(path: Path, *, title: str) -> list[Part]:
    """A price list: its picture and its table."""
    numbers = as_html(path.with_suffix(".md").read_text(encoding="utf-8"))
    picture = Picture(file_uri(path.with_suffix(".png")), f"{title}, drawn from the table below")
    return [Part(title, [Gallery([picture]), Prose(numbers)])]


def _manifest(path: Path) -> list[Part]:
    """What was asked for, what ran, and what was read."""
    content = Manifest.read(path)
    asked = content.request
    plain = {key: value for key, value in asked.items() if not isinstance(value, dict)}
    nested = {
        key: value
        for section in asked.values()
        if isinstance(section, dict)
        for key, value in section.items()
    }
    request = [[f"`{key}`", _words(value)] for key, value in (plain | nested).items()]
    versions = [[name, version] for name, version in content.versions.items()]
    inputs = [[f"`{name}`", f"`{digest}`"] for name, digest in content.inputs.items()]
    return [
        Part(
            "Manifest",
            [
                Prose(as_html(table(["asked for", "value"], request))),
                Details("Versions", as_html(table(["package", "version"], versions))),
                Details("Files read", as_html(table(["file", "SHA-256"], inputs))),
            ],
        )
    ]


def _words(value: Any) -> str:
    if value is None:
        return "–"
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)


READERS: dict[str, Reader] = {
    "summary.json": attack_parts,
    "results.json": evidence_parts,
    "accuracy.json": partial(_prices, title="What accuracy costs"),
    "generator.json": partial(_prices, title="What the gradient costs"),
    **{f"{name}.json": comparison_parts for name in TITLES},
}
"""File that a finished command leaves → what makes its parts."""
