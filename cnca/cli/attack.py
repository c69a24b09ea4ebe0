"""Commands that search a camouflage."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cnca.cli.app import app
from cnca.cli.help import ATTACK, BEGIN
from cnca.cli.options import Given, Scorer, takes
from cnca.core.options import OUTPUT, STRENGTH, WHAT
from cnca.jobs.attack.request import Request

Tau = Annotated[
    str,
    typer.Option(help="Bound on each element of F_adv; inf for none.", rich_help_panel=STRENGTH),
]


@app.command(rich_help_panel=ATTACK)
@takes(Request)
def optimize(
    given: Given[Request],
    tau: Annotated[
        str,
        typer.Option(
            help="Bound on each element of F_adv; inf for none, auto to search it.",
            rich_help_panel=STRENGTH,
        ),
    ] = "1.0",
    min_prompt_score: Annotated[
        float | None,
        typer.Option(
            help="With --tau auto: cosine that the texture must keep.", rich_help_panel=STRENGTH
        ),
    ] = None,
    scorer: Scorer = None,
    dry_run: Annotated[
        bool,
        typer.Option(
            "--dry-run",
            help="Only measure some steps and say what all will take.",
            rich_help_panel=OUTPUT,
        ),
    ] = False,
) -> None:
    """Search the camouflage that a detector misses, and judge it on held-out views.

    Under torchrun --nproc-per-node N -m cnca optimize, N processes divide the work of each step.
    """
    from cnca.cli import attack_output as terminal
    from cnca.core import parallel

    with parallel.joined():
        if dry_run:
            from cnca.jobs.attack.forecast import dry_run as forecast

            forecast(given.record(), tau)
        else:
            terminal.optimize(given.record(), tau, min_prompt_score, scorer)


@app.command(rich_help_panel=ATTACK)
@takes(Request, without=["resume"])
def tradeoff(
    given: Given[Request],
    taus: Annotated[
        str, typer.Option(help="Bounds on F_adv to compare.", rich_help_panel=STRENGTH)
    ] = "0.1,0.5,1,1.5,inf",
    scorer: Scorer = None,
) -> None:
    """Attack under several bounds τ: the paper's table of naturalness against strength.

    The same command goes on after an interruption.
    """
    from cnca.cli import attack_output as terminal

    terminal.tradeoff(given.record(), taus, scorer)


@app.command(rich_help_panel=ATTACK)
@takes(Request, without=["prompt", "resume"])
def prompts(
    given: Given[Request],
    wanted: Annotated[list[str], typer.Argument(help="Prompts to compare.", rich_help_panel=WHAT)],
    tau: Tau = "1.0",
    scorer: Scorer = None,
) -> None:
    """Attack with several prompts: the paper's table of styles, with numbers and pictures.

    The same command goes on after an interruption.
    """
    from cnca.cli import attack_output as terminal

    terminal.prompts(given.record(prompt=wanted[0]), wanted, tau, scorer)


@app.command(rich_help_panel=BEGIN)
def demo(
    out: Annotated[Path, typer.Option(help="Folder of the run.")] = Path("out/demo"),
    steps: Annotated[int, typer.Option(help="Updates of F_adv.")] = 80,
) -> None:
    """The main job on what ships with the package: a few minutes on two cores."""
    from cnca.cli import attack_output as terminal

    terminal.demo(out, steps)
