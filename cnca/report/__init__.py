"""The report of a run: one HTML file that holds everything, made from what lies in the folder.

:mod:`cnca.report.parts` says which files of a folder become which parts of the page.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from cnca.core.files import write_text

if TYPE_CHECKING:
    from cnca.report.blocks import Turntable

MEANING = {
    "before": "plain paint",
    "prompt": "prompt texture with F_adv = 0",
    "random": "random blocks (control)",
    "shuffled": "camouflage, shuffled in blocks (control: same palette)",
    "mirrored": "camouflage, mirrored (control)",
    "mean": "its mean color (control)",
    "seeds": "best of other seeds of the prompt, without an attack (control)",
    "after": "camouflage",
}
"""Texture of a ``cnca optimize`` → what it is; not every run has all of them."""

SHOWN_VIEWS = 4
TEMPLATES = Path(__file__).parent / "templates"


def write_report(folder: Path, turntables: Sequence[Turntable] = ()) -> Path:
    """Write ``report.html`` into the run folder ``folder``; returns its path.

    Raises:
        RunError: the folder holds no finished run, or a damaged one.
    """
    from cnca.report.blocks import Part
    from cnca.report.parts import read_parts
    from cnca.report.webpage import render

    first, *others = read_parts(folder)
    if turntables:
        others.insert(0, Part("All around", turntables))
    path = folder / "report.html"
    page = render(TEMPLATES, title=first.title, folder=folder.name, parts=[first, *others])
    write_text(path, page)
    return path


def shown_views(count: int) -> range:
    """Which of ``count`` held-out views ``before_after.png`` shows: some, spread over them all."""
    wanted = min(SHOWN_VIEWS, count)
    return range(0, count // wanted * wanted, count // wanted)
