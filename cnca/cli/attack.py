"""Commands that search a camouflage."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from cnca.cli.app import app
from cnca.cli.help import ATTACK, BEGIN
from cnca.cli.options import Given, Scorer, takes
from cnca.core.errors import RunError
from cnca.core.options import OUTPUT, STRENGTH, WHAT
from cnca.jobs.attack.presets import BEST, OF_NOISES, PRESETS, under_preset
from cnca.jobs.attack.request import Request
from cnca.jobs.transfer_request import Judging
from cnca.jobs.view.turntable_request import TurntableRequest

DEMO_SCENE, DEMO_PROMPT = Path("builtin:street_day"), "colorful camouflage"

Tau = Annotated[
    str | None,
    typer.Option(
        help="Bound on how far each element moves; inf for none. By default 1 for F_adv, inf for "
        "noises.",
        rich_help_panel=STRENGTH,
    ),
]

Preset = Annotated[
    str,
    typer.Option(
        help="Values of flags that are not given: best (the strongest natural result for the time) "
        "or paper (the paper's setting).",
        rich_help_panel=STRENGTH,
    ),
]


@app.command(rich_help_panel=ATTACK)
@takes(Request, presets=PRESETS)
def optimize(
    given: Given[Request],
    preset: Preset = BEST,
    tau: Annotated[
        str | None,
        typer.Option(
            help="Bound on how far each element moves; inf for none, auto to search it. By default "
            "1 for F_adv, inf for noises.",
            rich_help_panel=STRENGTH,
        ),
    ] = None,
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
    from cnca.core import parallel
    from cnca.jobs.attack.runs import bounded

    with parallel.joined():
        request = _asked(given, preset)
        if dry_run:
            _forecast(bounded(request, tau))
        elif tau == "auto":
            _search_tau(request, min_prompt_score, scorer)
        elif min_prompt_score is not None or scorer is not None:
            raise RunError("--min-prompt-score and --scorer belong to --tau auto; leave them out")
        else:
            run_attack(bounded(request, tau))


@app.command(rich_help_panel=ATTACK)
@takes(Request, without=["resume"], presets=PRESETS)
def tradeoff(
    given: Given[Request],
    preset: Preset = "paper",
    taus: Annotated[
        str, typer.Option(help="Bounds to compare.", rich_help_panel=STRENGTH)
    ] = "0.1,0.5,1,1.5,inf",
    scorer: Scorer = None,
) -> None:
    """Attack under several bounds τ: the paper's table of naturalness against strength.

    The same command goes on after an interruption.
    """
    from cnca.cli import show
    from cnca.gen.scorer import load_scorer
    from cnca.jobs.attack.runs import read_taus, tradeoff

    request = _asked(given, preset)
    tradeoff(request, read_taus(taus), load_scorer(scorer), show.messages())
    show.attack_table(request.out, "tradeoff")


@app.command(rich_help_panel=ATTACK)
@takes(Request, without=["prompt", "resume"], presets=PRESETS)
def prompts(
    given: Given[Request],
    preset: Preset = BEST,
    *,
    wanted: Annotated[list[str], typer.Argument(help="Prompts to compare.", rich_help_panel=WHAT)],
    tau: Tau = None,
    scorer: Scorer = None,
) -> None:
    """Attack with several prompts: the paper's table of styles, with numbers and pictures.

    The same command goes on after an interruption.
    """
    from cnca.cli import show
    from cnca.gen.scorer import load_scorer
    from cnca.jobs.attack.runs import bounded, prompts

    request = bounded(_asked(given, preset, prompt=wanted[0]), tau)
    prompts(request, wanted, load_scorer(scorer), show.messages())
    show.attack_table(request.out, "prompts")


@app.command(rich_help_panel=ATTACK)
@takes(Request, Judging, without=["resume"])
def transfer(
    given: Given[Request], judging: Given[Judging], preset: Preset = "best", tau: Tau = None
) -> None:
    """Attack each white box in turn and let every detector judge: a square with intervals.

    The same command goes on after an interruption.
    """
    from cnca.cli import show
    from cnca.core.interrupts import resumable
    from cnca.jobs.attack.runs import bounded
    from cnca.jobs.transfer import square_rows, transfer

    request, console = bounded(_asked(given, preset), tau), show.messages()
    with resumable(console, f"the same command goes on in {request.out}"):
        results = transfer(request, judging.record(), console)
    show.table(*square_rows(results))
    show.ending({"table": request.out / "transfer.md", "numbers": request.out / "transfer.json"})


@app.command(rich_help_panel=BEGIN)
def demo(
    out: Annotated[Path, typer.Option(help="Folder of the run.", rich_help_panel=OUTPUT)] = Path(
        "out/demo"
    ),
    steps: Annotated[
        int, typer.Option(help="Updates of the noises.", rich_help_panel=STRENGTH)
    ] = 40,
) -> None:
    """The main job on what ships with the package: a few minutes on two cores."""
    from cnca.attack.settings import Settings

    resume = (out / "manifest.json").exists() and not (out / "summary.json").exists()
    # Views that come back soon: the first look at one in a street takes longer than the step.
    settings = Settings(DEMO_PROMPT, steps=steps, views_per_step=6, view_pool=48)
    request = Request(
        DEMO_SCENE,
        out,
        settings,
        samples=4,
        gradient_checkpointing=False,
        held_out_views=16,
        resume=resume,
    )
    request = under_preset(request, but=["minutes", "views_per_step", "view_pool"])
    run_attack(request)
    _turn(out)


def _turn(run: Path) -> None:
    """End with a look: the turntable of a run."""
    from cnca.cli import show
    from cnca.jobs.view.turntable import turntable

    show.ending({"turntable": turntable(TurntableRequest(run), show.messages())})


@app.command(rich_help_panel=ATTACK)
def rerun(
    manifest: Annotated[Path, typer.Argument(help="manifest.json of a run.", rich_help_panel=WHAT)],
    out: Annotated[Path, typer.Option(help="Folder of the new run.", rich_help_panel=OUTPUT)],
) -> None:
    """Repeat a run from its manifest, and say whether its texture came out the same."""
    from cnca.cli import show
    from cnca.jobs.attack.rerun import rerun

    show.rerun(rerun(manifest, out, show.messages()))


def _asked(given: Given[Request], preset: str, **more: Any) -> Request:
    """What the flags say; what they do not say is the preset's.

    Raises RunError where both a time and a number of steps are given.
    """
    but = [flag for flag in (*PRESETS.get(preset, ()), "steps", "minutes") if given.said(flag)]
    if {"steps", "minutes"} <= set(but):
        raise RunError("--steps and --minutes: the one decides the other; leave one out")
    if "steps" in but:
        but.append("minutes")
    if given.said("generator") or given.said("variable"):
        but += OF_NOISES  # other models have sizes of their own, and F_adv is bound to places
    return under_preset(given.record(**more), preset, but=but)


def run_attack(request: Request) -> None:
    """Run an attack with progress, then say how it went and where everything is.

    Ctrl-C or SIGTERM ends with the words that resume the run; see :mod:`cnca.core.interrupts`.
    """
    from cnca.cli import show
    from cnca.core.interrupts import resumable
    from cnca.jobs.attack.run import run

    console = show.messages()
    with resumable(console, f"the same command with --resume goes on in {request.out}"):
        summary = run(request, console)
    show.attack(request, summary)


def _forecast(request: Request) -> None:
    """Say what an attack will take."""
    from cnca.cli import show
    from cnca.jobs.attack.forecast import forecast

    show.forecast(forecast(request))


def _search_tau(request: Request, least: float | None, scorer: Path | None) -> None:
    """Attack under several bounds for the strongest that keeps the prompt score ``least``."""
    if least is None:
        raise RunError("--tau auto: say --min-prompt-score, the cosine that must be kept")
    from cnca.cli import show
    from cnca.gen.scorer import load_scorer
    from cnca.jobs.attack.auto_tau import auto_tau

    choice = auto_tau(request, least, load_scorer(scorer), show.messages())
    show.chosen_tau(request.out, choice)
