"""Commands that train what ships with the package, and harden it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cnca.cli.app import app
from cnca.cli.help import TRAIN
from cnca.cli.options import Given, Resume, Seed, takes
from cnca.core.options import OUTPUT, WHAT
from cnca.jobs.efr_request import EfrRequest
from cnca.jobs.hardening_request import HardeningRequest
from cnca.train.detector.request import DetectorRequest


@app.command("train-generator", rich_help_panel=TRAIN)
def train_generator(
    out: Annotated[Path, typer.Option(help="Folder for the pipeline.", rich_help_panel=OUTPUT)],
    seed: Seed = 0,
    resume: Resume = False,
) -> None:
    """Train the shipped diffusion pipeline on procedural textures."""
    from cnca.train.generator.pipeline import train_generator

    train_generator(out, seed=seed, resume=resume)


@app.command("train-scorer", rich_help_panel=TRAIN)
def train_scorer(
    out: Annotated[Path, typer.Option(help="Folder for the scorer.", rich_help_panel=OUTPUT)],
    corpus: Annotated[
        Path,
        typer.Option(help="Folder of train-generator, for its pictures.", rich_help_panel=WHAT),
    ] = Path("out/generator"),
    seed: Seed = 0,
    resume: Resume = False,
) -> None:
    """Train the shipped prompt scorer on procedural textures, and test it on unseen ones."""
    from cnca.train.scorer import train_scorer

    trained = train_scorer(out, data=corpus, seed=seed, resume=resume)
    typer.echo(f"{trained.file}: right prompt of ten in {trained.right:.1%} of {trained.pictures}")


@app.command("train-style-judge", rich_help_panel=TRAIN)
def train_style_judge(
    out: Annotated[Path, typer.Option(help="Folder for its pictures and weights.")],
    seed: Seed = 0,
    resume: Resume = False,
) -> None:
    """Train the judge of style, apart from the generator and the scorer, and test it."""
    from cnca.train.style_judge import train_style_judge as train

    trained = train(out, seed=seed, resume=resume)
    typer.echo(
        f"{trained.file}: pattern right in {trained.style:.1%}, all color words in "
        f"{trained.colors:.1%} of {trained.pictures} unseen textures"
    )


@app.command("train-detector", rich_help_panel=TRAIN)
@takes(DetectorRequest)
def train_detector(given: Given[DetectorRequest], resume: Resume = False) -> None:
    """Train a built-in detector on renders of planes and streets, and on labelled frames."""
    from cnca.core.records import as_json
    from cnca.train.detector.builtin import train_builtin

    typer.echo(as_json(train_builtin(given.record(), resume=resume)))


@app.command(rich_help_panel=TRAIN)
@takes(HardeningRequest)
def harden(given: Given[HardeningRequest], resume: Resume = False) -> None:
    """Train a built-in detector on camouflages, and measure AP@0.5 before and after."""
    from cnca.cli import show
    from cnca.core.interrupts import resumable
    from cnca.jobs.harden import harden

    request, console = given.record(), show.messages()
    with resumable(console, f"the same command with --resume goes on in {request.out}"):
        harden(request, console, resume=resume)
    show.hardening(request)


@app.command("train-efr", rich_help_panel=TRAIN)
@takes(EfrRequest)
def train_efr(given: Given[EfrRequest], resume: Resume = False) -> None:
    """Train an EFR that corrects cheap renders towards path-traced ones or photographs."""
    from cnca.cli import show
    from cnca.core import parallel
    from cnca.jobs.train_efr import train_efr  # loads the renderer

    request = given.record()
    with parallel.joined():
        show.corrections(request, train_efr(request, show.messages(), resume=resume))
