"""Commands that render, and say what rendering costs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cnca.cli.app import app
from cnca.cli.help import BEGIN, RENDER
from cnca.cli.options import Generator, Samples, Seed


@app.command(rich_help_panel=BEGIN)
def doctor(
    json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,
) -> None:
    """Check LLVM, Mitsuba and the other packages, and render a test picture."""
    from cnca.jobs.doctor import diagnose

    report = diagnose()
    typer.echo(report.as_json() if json else "\n".join(report.lines()))
    raise typer.Exit(0 if report.healthy else 1)


@app.command("render-scene", rich_help_panel=RENDER)
def render_scene(
    scene: Annotated[Path, typer.Argument(help="Scene file, such as scenes/sedan_fog.yaml.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="Picture to write: .png or .exr.")],
    view: Annotated[str | None, typer.Option(help="Camera by name; by default the first.")] = None,
    all_views: Annotated[bool, typer.Option("--all-views", help="Every camera.")] = False,
    spp: Samples = None,
    texture: Annotated[Path | None, typer.Option(help="sRGB picture for the paint.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of the noise.")] = 0,
    target_error: Annotated[
        float | None, typer.Option(help="Take the cheapest models and samples under this error.")
    ] = None,
    reference: Annotated[bool, typer.Option("--reference", help="Full simulation.")] = False,
    effect: Annotated[
        list[str] | None,
        typer.Option(help="Model for one effect, such as fog=none or sun=disc; repeatable."),
    ] = None,
    explain: Annotated[bool, typer.Option("--explain", help="Say what is simulated how.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the records as JSON.")] = False,
) -> None:
    """Render a scene file: the picture, and a JSON record beside it."""
    from cnca.cli import render_output as terminal
    from cnca.effects.catalog import parse_effects
    from cnca.effects.plan import Demand
    from cnca.jobs.render_scene import render_scene

    records = render_scene(
        scene,
        out,
        view=view,
        all_views=all_views,
        samples=spp,
        demand=Demand(target_error, reference, parse_effects(effect or [])),
        texture=texture,
        seed=seed,
    )
    terminal.show_renders(out.parent, records, explain=explain, as_json=json)


@app.command(rich_help_panel=RENDER)
def accuracy(
    scene: Annotated[Path, typer.Argument(help="Scene file.")],
    out: Annotated[Path, typer.Option(help="Folder for table, picture and reference.")],
    seconds: Annotated[float, typer.Option(help="Budget of time.")] = 900.0,
    view: Annotated[str | None, typer.Option(help="Camera by name; by default the first.")] = None,
    detector: Annotated[
        str, typer.Option(help="builtin, or a Darknet .cfg, or an .onnx.")
    ] = "builtin",
    volpath: Annotated[
        bool, typer.Option("--volpath", help="Fog's reference by Mitsuba's volumetric path tracer.")
    ] = False,
) -> None:
    """Measure what accuracy costs in time; the same command goes on after an interruption."""
    from cnca.cli import render_output as terminal

    terminal.accuracy(scene, out, seconds=seconds, view=view, detector=detector, volpath=volpath)


@app.command("accuracy-generator", rich_help_panel=RENDER)
def accuracy_generator(
    out: Annotated[Path, typer.Option(help="Folder for table and picture.")],
    prompt: Annotated[str, typer.Option(help="What to paint.")] = "colorful camouflage",
    generator: Generator = None,
    feature: Annotated[str, typer.Option(help="concat or replace.")] = "concat",
    guidance: Annotated[float, typer.Option(help="Scale of classifier-free guidance.")] = 2.5,
    probes: Annotated[int, typer.Option(help="Gradients to average over.")] = 3,
    seed: Seed = 0,
) -> None:
    """Measure what going back through fewer denoising steps costs the gradient."""
    from cnca.cli import render_output as terminal

    terminal.generator_accuracy(
        out,
        prompt=prompt,
        generator=generator,
        feature=feature,
        guidance=guidance,
        probes=probes,
        seed=seed,
    )


@app.command(rich_help_panel=RENDER)
def calibrate(
    out: Annotated[Path, typer.Option(help="Folder for the cases and prices.json.")],
    scenes: Annotated[int, typer.Option(help="Random scenes to measure.")] = 32,
    seed: Annotated[int, typer.Option(help="Number of the first scene.")] = 0,
) -> None:
    """Measure errors and times of all models, from which render-scene's plan predicts."""
    from rich.console import Console

    from cnca.jobs.accuracy.calibrate import calibrate

    console = Console(stderr=True)
    typer.echo(calibrate(out, scenes=scenes, seed=seed, console=console))
