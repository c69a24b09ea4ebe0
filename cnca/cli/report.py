"""Commands that show results to people, and ask people about them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cnca.cli.app import app
from cnca.cli.help import ATTACK, JUDGE, Group
from cnca.cli.options import Given, takes
from cnca.core.options import COST, OUTPUT, WHAT
from cnca.jobs.view.turntable_request import TurntableRequest

survey = typer.Typer(
    cls=Group, help="Ask people how natural pictures look: the paper's appendix A."
)
app.add_typer(survey, name="survey", rich_help_panel=JUDGE)

Folder = Annotated[
    Path, typer.Argument(help="The --out of cnca survey build.", rich_help_panel=WHAT)
]


@app.command(rich_help_panel=ATTACK)
def report(
    folder: Annotated[
        Path, typer.Argument(help="The --out of a command that has ended.", rich_help_panel=WHAT)
    ],
    turntable: Annotated[
        int,
        typer.Option(
            help="Frames around the vehicle, rendered once; 0 for none.", rich_help_panel=COST
        ),
    ] = 24,
) -> None:
    """Gather a run's results in one HTML file: pictures, curves, tables, manifest."""
    from cnca.cli import show
    from cnca.report import write_report
    from cnca.report.turntable import turntables

    page = write_report(folder, turntables(folder, turntable, show.messages()))
    show.ending({"report": page})


@app.command(rich_help_panel=ATTACK)
@takes(TurntableRequest)
def turntable(given: Given[TurntableRequest]) -> None:
    """Let a run's vehicle turn in its scene: plain paint, camouflage, the detector's boxes."""
    request = given.record()
    from cnca.cli import show
    from cnca.jobs.view.turntable import turntable

    path = turntable(request, show.messages())
    show.ending({"turntable": path}, ["report", request.run])


@app.command(rich_help_panel=ATTACK)
def watch(
    runs: Annotated[
        list[Path],
        typer.Argument(help="Folders of runs, going on or ended.", rich_help_panel=WHAT),
    ],
    port: Annotated[
        int, typer.Option(help="Of the page; 0 takes any that is free.", rich_help_panel=OUTPUT)
    ] = 8200,
) -> None:
    """Show runs in the browser while they go on: curves, scores, pictures; until Ctrl-C."""
    import time

    from cnca.cli import show
    from cnca.jobs.view.serve import serving
    from cnca.jobs.view.watch import WatchPage

    with serving(WatchPage(runs), port) as address:
        show.line(f"{address} – open it in a browser; Ctrl-C ends it")
        try:
            while True:
                time.sleep(3600)
        except KeyboardInterrupt:
            show.ending({}, ["report", runs[0]])


@survey.command("build")
def build_survey(
    images: Annotated[
        list[str],
        typer.Option(
            help="[NAME=]PATH: a folder with one folder for each source, the pictures of one "
            "source, or one picture; repeatable.",
            rich_help_panel=WHAT,
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder of the survey.", rich_help_panel=OUTPUT)],
    question: Annotated[
        str | None,
        typer.Option(
            help="What is asked; by default how natural the vehicle looks.", rich_help_panel=WHAT
        ),
    ] = None,
) -> None:
    """Make the survey's page, which works as a file and with cnca survey serve."""
    from cnca.jobs.survey.build import build_survey, uneven

    survey = build_survey(images, out, question=question)
    odd = uneven(survey)
    if odd is not None:
        typer.echo(f"note: {odd} lacks views (file names) that others have", err=True)
    typer.echo(f"{len(survey.sources)} pictures: {out / 'index.html'}")


@survey.command("serve")
def serve_survey(
    folder: Folder,
    port: Annotated[
        int, typer.Option(help="0 takes any that is free.", rich_help_panel=OUTPUT)
    ] = 8000,
    host: Annotated[
        str,
        typer.Option(
            help="Address to listen on; by default only this machine reaches it.",
            rich_help_panel=OUTPUT,
        ),
    ] = "127.0.0.1",
) -> None:
    """Hand out the page and collect the answers, until Ctrl-C."""
    from cnca.jobs.survey.serve import SurveyServer

    with SurveyServer(folder, host=host, port=port) as server:
        typer.echo(f"http://{host}:{server.server_port}/ – Ctrl-C ends it")
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            typer.echo(f"{len(server.store.sheets())} participants so far")


@survey.command("score")
def score_survey(folder: Folder) -> None:
    """Score the answers: mean ± standard deviation by source, tests, the paper's Table 4."""
    from cnca.jobs.survey.score import score_survey

    score_survey(folder)
    typer.echo((folder / "score.md").read_text(encoding="utf-8"))
    for ending in ("md", "tex", "json"):
        typer.echo(folder / f"score.{ending}")
