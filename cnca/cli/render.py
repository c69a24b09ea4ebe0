"""Commands that render, and say what rendering costs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cnca.cli.app import app
from cnca.cli.help import BEGIN, RENDER
from cnca.cli.options import Given, takes
from cnca.core.options import COST, OUTPUT, WHAT
from cnca.jobs.accuracy.request import AccuracyRequest, GradientRequest
from cnca.jobs.render_request import RenderRequest
from cnca.jobs.view.request import ViewRequest


@app.command(rich_help_panel=BEGIN)
def doctor(
    json: Annotated[
        bool, typer.Option("--json", help="Print the report as JSON.", rich_help_panel=OUTPUT)
    ] = False,
) -> None:
    """Check LLVM, Mitsuba and the other packages, and render a test picture."""
    from cnca.jobs.doctor import diagnose

    report = diagnose()
    typer.echo(report.as_json() if json else "\n".join(report.lines()))
    raise typer.Exit(0 if report.healthy else 1)


@app.command("render-scene", rich_help_panel=RENDER)
@takes(RenderRequest)
def render_scene(
    given: Given[RenderRequest],
    explain: Annotated[
        bool,
        typer.Option("--explain", help="Say what is simulated how.", rich_help_panel=OUTPUT),
    ] = False,
    json: Annotated[
        bool,
        typer.Option("--json", help="Print the records as JSON.", rich_help_panel=OUTPUT),
    ] = False,
) -> None:
    """Render a scene file: the picture, and a JSON record beside it."""
    import json as text

    from cnca.cli import show
    from cnca.core.records import as_json
    from cnca.jobs.render_scene import render_scene

    request = given.record()
    records = render_scene(request)
    if json:
        typer.echo(text.dumps([as_json(record) for record in records], indent=2))
    else:
        show.renders(request, records, explain=explain)


@app.command(rich_help_panel=RENDER)
@takes(ViewRequest)
def view(given: Given[ViewRequest]) -> None:
    """Show a scene in the browser, path-traced while you turn it; until Ctrl-C."""
    request = given.record()  # first: what is wrong with it is said at once
    from cnca.cli import show
    from cnca.jobs.view.live import LivePage
    from cnca.jobs.view.serve import serving
    from cnca.scene.load_scene import load_scene

    page = LivePage(request, load_scene(request.scene))
    with serving(page, request.port) as address:
        show.line(f"{address} – open it in a browser; Ctrl-C ends it")
        try:
            page.run()
        except KeyboardInterrupt:
            show.ending({}, ["render-scene", request.scene, "-o", request.out / "picture.png"])


@app.command(rich_help_panel=RENDER)
@takes(AccuracyRequest)
def accuracy(given: Given[AccuracyRequest]) -> None:
    """Measure what accuracy costs in time; the same command goes on after an interruption."""
    from cnca.cli import show
    from cnca.jobs.accuracy.ladder import accuracy  # loads colour-science, which is slow

    request = given.record()
    show.price_list(request.out, accuracy(request, show.messages()))


@app.command("accuracy-generator", rich_help_panel=RENDER)
@takes(GradientRequest)
def accuracy_generator(given: Given[GradientRequest]) -> None:
    """Measure what going back through fewer denoising steps costs the gradient."""
    from cnca.cli import show
    from cnca.jobs.accuracy.generator import generator_accuracy

    request = given.record()
    show.gradient_prices(request.out, generator_accuracy(request, show.messages()))


@app.command(rich_help_panel=RENDER)
def calibrate(
    out: Annotated[
        Path, typer.Option(help="Folder for the cases and prices.json.", rich_help_panel=OUTPUT)
    ],
    scenes: Annotated[
        int, typer.Option(help="Random scenes to measure.", rich_help_panel=COST)
    ] = 32,
    seed: Annotated[int, typer.Option(help="Number of the first scene.", rich_help_panel=WHAT)] = 0,
    only: Annotated[
        str | None,
        typer.Option(
            help="Price this effect alone, beside the shipped prices.", rich_help_panel=WHAT
        ),
    ] = None,
) -> None:
    """Measure errors and times of all models, from which render-scene's plan predicts."""
    from rich.console import Console

    from cnca.jobs.accuracy.calibrate import calibrate

    console = Console(stderr=True)
    typer.echo(calibrate(out, scenes=scenes, seed=seed, console=console, only=only))
