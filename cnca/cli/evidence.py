"""Commands that measure what a camouflage is worth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cnca.cli.app import app
from cnca.cli.help import JUDGE
from cnca.cli.options import Generator, Samples, Seed
from cnca.cli.run_file import Config
from cnca.core.errors import RunError


@app.command(rich_help_panel=JUDGE)
def evaluate(
    out: Annotated[Path, typer.Option(help="Folder for results; a rerun goes on in it.")],
    scene: Annotated[list[Path] | None, typer.Option(help="Scene file; repeatable.")] = None,
    texture: Annotated[
        list[str] | None,
        typer.Option(
            help="[NAME=]PATH: UV picture, a run's folder, .npy colours of faces, or PATH@1.5m, a "
            "pattern that repeats every 1.5 m; repeatable."
        ),
    ] = None,
    detector: Annotated[
        list[str] | None, typer.Option(help="[NAME=]builtin, .cfg or .onnx; repeatable.")
    ] = None,
    views: Annotated[int, typer.Option(help="Views of each scene.")] = 96,
    grid: Annotated[
        str | None,
        typer.Option(help="paper: a sample of its 8192 views; by default the scene's ranges."),
    ] = None,
    carla: Annotated[
        Path | None, typer.Option(help="Folder of CARLA frames to draw the textures into.")
    ] = None,
    fov: Annotated[float, typer.Option(help="Horizontal field of view of these frames.")] = 90.0,
    photos: Annotated[
        Path | None, typer.Option(help="Folder of photographs, one row for each folder in it.")
    ] = None,
    labels: Annotated[
        Path | None, typer.Option(help="Their COCO .json, or VOC .xml or a folder of these.")
    ] = None,
    paper_figures: Annotated[
        bool, typer.Option("--paper-figures", help="With --photos: the paper's Table 2 beside.")
    ] = False,
    prompt: Annotated[
        str | None, typer.Option(help="Adds its texture with F_adv = 0 to the controls.")
    ] = None,
    generator: Generator = None,
    no_controls: Annotated[
        bool, typer.Option("--no-controls", help="Only the normal paint beside the textures.")
    ] = False,
    spp: Samples = None,
    seed: Seed = 0,
    config: Config = None,
) -> None:
    """Measure AP@0.5 of textures against controls, with confidence intervals."""
    from cnca.cli import evidence_output as terminal
    from cnca.jobs.evaluate.parts import Request
    from cnca.judge.candidates import CONTROLS

    detectors = tuple(detector or ["builtin"])
    if photos is not None or labels is not None:
        if scene or texture or prompt or carla:
            raise RunError(
                "--photos: photographs are judged as they are; leave out --scene, --texture, "
                "--prompt and --carla, or --photos"
            )
        terminal.photos(photos, labels, out, detectors, seed=seed, paper_figures=paper_figures)
        return
    terminal.evidence(
        Request(
            tuple(scene or ()),
            out,
            tuple(texture or ()),
            detectors,
            views=views,
            grid=grid,
            carla=carla,
            fov=fov,
            prompt=prompt,
            generator=generator,
            controls=() if no_controls else CONTROLS,
            samples=spp,
            seed=seed,
        )
    )


@app.command(rich_help_panel=JUDGE)
def table1(
    scene: Annotated[list[Path], typer.Option(help="Scene file; repeatable.")],
    texture: Annotated[
        list[str], typer.Option(help="As for evaluate, by the paper's names: DTA=dta.png@1.5m.")
    ],
    out: Annotated[Path, typer.Option(help="Folder for results; a rerun goes on in it.")],
    detector: Annotated[
        list[str] | None, typer.Option(help="[NAME=]builtin, .cfg or .onnx; repeatable.")
    ] = None,
    views: Annotated[int, typer.Option(help="Sample of the paper's 8192 views.")] = 256,
    paper_figures: Annotated[
        bool, typer.Option("--paper-figures", help="The paper's numbers beside ours.")
    ] = False,
    spp: Samples = None,
    seed: Seed = 0,
    config: Config = None,
) -> None:
    """Make the paper's Table 1: AP@0.5 of its methods' textures over its grid of views."""
    from cnca.cli import evidence_output as terminal
    from cnca.jobs.evaluate.parts import Request

    request = Request(
        tuple(scene),
        out,
        tuple(texture),
        tuple(detector or ["builtin"]),
        views=views,
        grid="paper",
        controls=("random",),
        samples=spp,
        seed=seed,
    )
    terminal.table1(request, paper_figures=paper_figures)
