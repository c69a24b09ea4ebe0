"""Commands that measure what a camouflage is worth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cnca.cli.app import app
from cnca.cli.help import JUDGE
from cnca.cli.options import Given, takes
from cnca.core.errors import RunError
from cnca.core.options import COST, OUTPUT, WHAT
from cnca.jobs.evaluate.request import EvaluationRequest, PhotoRequest

if TYPE_CHECKING:
    from cnca.judge.records import Evidence


@app.command(rich_help_panel=JUDGE)
@takes(EvaluationRequest, PhotoRequest)
def evaluate(
    views: Given[EvaluationRequest],
    photographs: Given[PhotoRequest],
    photos: Annotated[
        Path | None,
        typer.Option(
            help="Folder of photographs, one row for each folder in it.", rich_help_panel=WHAT
        ),
    ] = None,
    labels: Annotated[
        Path | None,
        typer.Option(
            help="Their COCO .json, or a folder of VOC .xml or YOLO .txt.", rich_help_panel=WHAT
        ),
    ] = None,
    no_controls: Annotated[
        bool,
        typer.Option(
            "--no-controls",
            help="Only the normal paint beside the textures.",
            rich_help_panel=COST,
        ),
    ] = False,
) -> None:
    """Measure AP@0.5 of textures against controls, with confidence intervals."""
    if photos is None and labels is None:
        _judge_views(views.record(**{"controls": ()} if no_controls else {}))
        return
    if views.asks_for("scenes", "textures", "prompt", "carla"):
        raise RunError(
            "--photos: photographs are judged as they are; leave out --scene, --texture, "
            "--prompt and --carla, or --photos"
        )
    if photos is None or labels is None:
        raise RunError("--photos and --labels belong together: give both")
    _judge_photos(photographs.record(photos=photos, labels=labels))


@app.command(rich_help_panel=JUDGE)
@takes(EvaluationRequest, without=["grid", "carla", "fov", "prompt", "generator", "protocol"])
def table1(
    given: Given[EvaluationRequest],
    scene: Annotated[
        list[Path], typer.Option(help="Scene file; repeatable.", rich_help_panel=WHAT)
    ],
    texture: Annotated[
        list[str],
        typer.Option(
            help="As for evaluate, by the paper's names: DTA=dta.png@1.5m.", rich_help_panel=WHAT
        ),
    ],
    views: Annotated[
        int, typer.Option(help="Sample of the paper's 8192 views.", rich_help_panel=COST)
    ] = 256,
    paper_figures: Annotated[
        bool,
        typer.Option(
            "--paper-figures", help="The paper's numbers beside ours.", rich_help_panel=OUTPUT
        ),
    ] = False,
) -> None:
    """Make the paper's Table 1: AP@0.5 of its methods' textures over its grid of views."""
    request = given.record(
        scenes=tuple(scene),
        textures=tuple(texture),
        views=views,
        grid="paper",
        controls=("random",),
    )
    from cnca.cli import show
    from cnca.report.paper_tables import write_table1

    results = _evaluated(request)
    path = write_table1(request.out, results, paper_figures=paper_figures)
    show.evidence(results)
    show.ending({"all else": request.out / "results.md", "table": path})


def _judge_views(request: EvaluationRequest) -> None:
    """Evaluate textures with progress, then say what each reaches."""
    from cnca.cli import show
    from cnca.core import parallel
    from cnca.report.tables import blind, headlines, protocol_rows

    with parallel.joined():
        results = _evaluated(request)
        if request.protocol:
            show.table(*protocol_rows(results, request.protocol))
        else:
            show.evidence(results)
        for sentence in headlines(results):
            show.line(sentence)
        for warning in blind(results):
            show.messages().print(warning, soft_wrap=True, markup=False, highlight=False)
        show.ending({"tables and pictures": request.out / "results.md"}, ["report", request.out])


def _evaluated(request: EvaluationRequest) -> Evidence:
    """The results, gathered with progress; after an interruption the same command goes on."""
    from cnca.cli import show
    from cnca.core.interrupts import resumable
    from cnca.jobs.evaluate.evaluation import evaluate_scenes

    console = show.messages()
    with resumable(console, f"the same command goes on in {request.out}"):
        return evaluate_scenes(request, console)


def _judge_photos(request: PhotoRequest) -> None:
    """Judge detectors on photographs with progress, then print the paper's Table 2."""
    from cnca.cli import show
    from cnca.core import parallel
    from cnca.core.interrupts import resumable
    from cnca.jobs.evaluate.photos import evaluate_photos

    with parallel.joined():
        console = show.messages()
        with resumable(console, f"the same command goes on in {request.out}"):
            results = evaluate_photos(request, console)
        show.photographs(results)
        show.ending({"AP@0.5 of the car (VOC); all else": request.out / "results.md"})
