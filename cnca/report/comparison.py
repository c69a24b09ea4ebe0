"""The parts of several attacks that differ in one thing: ``tradeoff``, ``prompts``, auto τ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cnca.core.records import read_record
from cnca.judge.summary import Summary
from cnca.report.attack import before_after
from cnca.report.blocks import Gallery, Part, Picture, Prose
from cnca.report.markdown import as_html
from cnca.report.webpage import file_uri

TITLES = {
    "tradeoff": "Naturalness against strength",
    "prompts": "Prompts compared",
    "auto_tau": "Search for the strongest bound",
}


@dataclass(frozen=True)
class ComparedRun:
    """One attack of a table."""

    label: str
    folder: str
    """Below that of the table."""


@dataclass(frozen=True)
class ComparedRuns:
    """The attacks of a table, in its order."""

    rows: Sequence[ComparedRun]


def comparison_parts(path: Path) -> list[Part]:
    """The table, the textures and a slider through all runs of ``path``, a table's numbers."""
    folder, name = path.parent, path.stem
    runs = [
        (row.label, folder / row.folder, read_record(Summary, folder / row.folder / "summary.json"))
        for row in read_record(ComparedRuns, path).rows
    ]
    textures = [
        Picture(file_uri(own / "texture.png"), f"texture, {label}", label) for label, own, _ in runs
    ]
    numbers = (folder / f"{name}.md").read_text(encoding="utf-8")
    return [
        Part(TITLES[name], [Prose(as_html(numbers))]),
        Part("Textures", [Gallery(textures)]),
        Part("Before and after", [before_after(runs)]),
    ]
