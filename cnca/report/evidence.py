"""The parts of a ``cnca evaluate``: its results as they stand, and its pictures to compare."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cnca.core.pictures import SrgbPicture
from cnca.core.records import read_record
from cnca.judge.rows import NORMAL
from cnca.report.blocks import Gallery, Part, Picture, Prose, Slider, Strip
from cnca.report.markdown import as_html
from cnca.report.webpage import file_uri, jpeg_uri

SHOWN_VIEWS = 4
PICTURES = {
    "sections.png": "AP@0.5 by pose and weather",
    "azimuths.png": "AP@0.5 around the vehicle",
    "views_*.png": "views with what a detector reports",
    "photos_*.png": "photographs with what a detector reports",
}
"""File → what it shows."""


@dataclass(frozen=True)
class Pictured:
    """Those of an evaluation's results that lead to its pictures."""

    rows: Sequence[str]
    scenes: Sequence[str] = ()
    """None where photographs were judged."""


def evidence_parts(path: Path) -> list[Part]:
    """Tables and comparisons, a slider for each scene, the pictures; ``path``: the results."""
    folder, results = path.parent, read_record(Pictured, path)
    text = (folder / "results.md").read_text(encoding="utf-8").partition("## Pictures")[0]
    title, _, tables = text.partition("\n")
    sliders = [
        Part(f"Before and after: {scene}", [_slider(folder / "pictures" / scene, results.rows)])
        for scene in results.scenes
        if (folder / "pictures" / scene / NORMAL).is_dir()
    ]
    galleries = [
        Gallery([Picture(file_uri(path), meaning, meaning)])
        for pattern, meaning in PICTURES.items()
        for path in sorted(folder.glob(pattern))
    ]
    return [
        Part(title.lstrip("# "), [Prose(as_html(tables))]),
        *sliders,
        *([Part("Pictures", galleries)] if galleries else []),
    ]


def _slider(folder: Path, rows: Sequence[str]) -> Slider:
    """The normal paint on the left, every other row that was rendered on the right."""
    strips = {row: _views(folder / row.replace(" ", "~")) for row in rows}
    height, width = strips[NORMAL][0].shape[:2]
    left, *rights = [
        Strip(
            row,
            [Picture(jpeg_uri(view), f"{row}, view {n}", row) for n, view in enumerate(views, 1)],
        )
        for row, views in strips.items()
        if views
    ]
    rights.reverse()  # in the tables the candidates come last
    return Slider(left, rights, width, height)


def _views(folder: Path) -> list[SrgbPicture]:
    """Some views of one row, spread over its weathers; none of a row that has no pictures."""
    files = sorted(folder.glob("weather*.npz"))
    chosen = [files[i * len(files) // SHOWN_VIEWS] for i in range(SHOWN_VIEWS)] if files else []
    views = []
    for number, file in enumerate(chosen):
        with np.load(file, allow_pickle=False) as kept:
            pictures = kept["pictures"]
        views.append(np.ascontiguousarray(pictures[number % len(pictures)].transpose(1, 2, 0)))
    return views
