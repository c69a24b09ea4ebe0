"""What evaluations say: the table of textures and what each candidate reaches."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from rich.console import Console
from rich.table import Table

from cnca.core import parallel
from cnca.core.errors import RunError
from cnca.core.interrupts import resumable

if TYPE_CHECKING:
    from cnca.jobs.evaluate.parts import Request
    from cnca.judge.records import Evidence

Asked = TypeVar("Asked")
Found = TypeVar("Found")


@parallel.joined()
def evidence(request: Request) -> None:
    """Evaluate textures with progress, then say what each candidate reaches."""
    from cnca.jobs.evaluate.evaluation import evaluate_scenes
    from cnca.report.tables import headlines

    results = _gather(evaluate_scenes, request, request.out)
    shown = Console()
    shown.print(_evidence_table(results))
    for sentence in headlines(results):
        shown.print(sentence, soft_wrap=True)
    shown.print(f"tables and pictures: {request.out / 'results.md'}", soft_wrap=True)


def table1(request: Request, *, paper_figures: bool) -> None:
    """Make the paper's Table 1 with progress, then say where it is."""
    from cnca.jobs.evaluate.evaluation import evaluate_scenes
    from cnca.report.paper_tables import write_table1

    results = _gather(evaluate_scenes, request, request.out)
    path = write_table1(request.out, results, paper_figures=paper_figures)
    shown = Console()
    shown.print(_evidence_table(results))
    shown.print(f"table: {path}; all else: {request.out / 'results.md'}", soft_wrap=True)


@parallel.joined()
def photos(
    folder: Path | None, labels: Path | None, out: Path, detectors: tuple[str, ...], **options: Any
) -> None:
    """Judge detectors on photographs with progress, then print the paper's Table 2."""
    from cnca.jobs.evaluate.photos import PhotoRequest, evaluate_photos
    from cnca.report.tables import cell

    if folder is None or labels is None:
        raise RunError("--photos and --labels belong together: give both")
    request = PhotoRequest(folder, labels, out, detectors, **options)
    results = _gather(evaluate_photos, request, out)
    table = Table()
    for name in ("photographs", *results.detectors):
        table.add_column(name, no_wrap=True)
    for row, by_detector in results.all.items():
        aps = (by_detector[name]["car"]["AP_voc"] for name in results.detectors)
        table.add_row(row, *(cell(ap, digits=2) for ap in aps))
    shown = Console()
    shown.print(table)
    shown.print(f"AP@0.5 of the car (VOC); all else: {out / 'results.md'}", soft_wrap=True)


def _gather(work: Callable[[Asked, Console], Found], request: Asked, out: Path) -> Found:
    """Results of an evaluation; after an interruption the same command goes on."""
    console = Console(stderr=True, quiet=parallel.rank() > 0)
    with resumable(console, f"the same command goes on in {out}"):
        return work(request, console)


def _evidence_table(results: Evidence) -> Table:
    """Mean over the detectors, the vehicle's class, with 95 % intervals."""
    from cnca.judge.verdict import TOTAL
    from cnca.report.tables import cell

    table = Table()
    for name in ("texture", "AP@0.5 (VOC)", "AP@0.5 (COCO)", "score"):
        table.add_column(name, no_wrap=True)
    for row in results.rows:
        total = results.all[row][TOTAL][results.label]
        measures = ("AP_voc", "AP_coco", "score")
        table.add_row(row, *(cell(total[name], digits=2) for name in measures))
    return table
