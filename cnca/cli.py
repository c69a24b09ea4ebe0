"""The ``cnca`` command.  Commands import what they need inside, so that ``--help`` is instant."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from cnca import __version__
from cnca.errors import CncaError

app = typer.Typer(
    name="cnca",
    help="Customizable, natural adversarial camouflage: how robust is a vehicle detector?",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"cnca {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version and exit."
        ),
    ] = False,
) -> None:
    pass


@app.command()
def doctor(
    json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,
) -> None:
    """Check LLVM, Mitsuba and the other packages, and render a test picture."""
    from cnca.doctor import diagnose

    report = diagnose()
    typer.echo(report.as_json() if json else "\n".join(report.lines()))
    raise typer.Exit(0 if report.healthy else 1)


@app.command("render-scene")
def render_scene(
    scene: Annotated[Path, typer.Argument(help="Scene file, such as scenes/sedan_fog.yaml.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="Picture to write: .png or .exr.")],
    view: Annotated[str | None, typer.Option(help="Camera by name; by default the first.")] = None,
    all_views: Annotated[bool, typer.Option("--all-views", help="Every camera.")] = False,
    spp: Annotated[int | None, typer.Option(help="Rays per pixel instead of the scene's.")] = None,
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
    from cnca import terminal
    from cnca.render_scene import render_scene
    from cnca.scene.effects import Demand, parse_effects

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


@app.command()
def accuracy(
    scene: Annotated[Path, typer.Argument(help="Scene file.")],
    out: Annotated[Path, typer.Option(help="Folder for table, picture and reference.")],
    seconds: Annotated[float, typer.Option(help="Budget of time.")] = 900.0,
    view: Annotated[str | None, typer.Option(help="Camera by name; by default the first.")] = None,
    detector: Annotated[
        str, typer.Option(help="builtin, or a Darknet .cfg, or an .onnx.")
    ] = "builtin",
) -> None:
    """Measure what accuracy costs in time; the same command goes on after an interruption."""
    from cnca import terminal

    terminal.accuracy(scene, out, seconds=seconds, view=view, detector=detector)


@app.command()
def calibrate(
    out: Annotated[Path, typer.Option(help="Folder for the cases and prices.json.")],
    scenes: Annotated[int, typer.Option(help="Random scenes to measure.")] = 32,
    seed: Annotated[int, typer.Option(help="Number of the first scene.")] = 0,
) -> None:
    """Measure errors and times of all models, from which render-scene's plan predicts."""
    from rich.console import Console

    from cnca.calibrate import calibrate

    console = Console(stderr=True)
    typer.echo(calibrate(out, scenes=scenes, seed=seed, console=console))


@app.command()
def optimize(
    scene: Annotated[Path, typer.Option(help="Scene file.")],
    prompt: Annotated[str, typer.Option(help="What the paint is to look like.")],
    out: Annotated[Path, typer.Option(help="Folder of the run.")],
    detector: Annotated[str, typer.Option(help="builtin, or a Darknet .cfg.")] = "builtin",
    backend: Annotated[str, typer.Option(help="Renderer.")] = "mitsuba",
    tau: Annotated[float, typer.Option(help="Bound on each element of F_adv; inf for none.")] = 1.0,
    steps: Annotated[int, typer.Option(help="Updates of F_adv.")] = 100,
    views_per_step: Annotated[int, typer.Option(help="Pictures per update.")] = 8,
    learning_rate: Annotated[float, typer.Option(help="Adam's step size.")] = 0.01,
    full_overlap: Annotated[
        float, typer.Option(help="IoU from which a box counts in full; 1 is the paper's loss.")
    ] = 1.0,
    generator: Annotated[
        Path | None, typer.Option(help="Folder in diffusers format; by default the shipped one.")
    ] = None,
    efr: Annotated[Path | None, typer.Option(help="Trained EFR that corrects renders.")] = None,
    tokens: Annotated[int, typer.Option(help="Tokens of F_adv.")] = 77,
    guidance: Annotated[float, typer.Option(help="Scale of classifier-free guidance.")] = 4.0,
    spp: Annotated[int, typer.Option(help="Rays per pixel in the loop.")] = 16,
    held_out_views: Annotated[int, typer.Option(help="Views that judge the result.")] = 24,
    seed: Annotated[int, typer.Option(help="Seed of everything random.")] = 0,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with an interrupted run.")
    ] = False,
) -> None:
    """Search the camouflage that a detector misses, and judge it on held-out views."""
    from cnca import terminal
    from cnca.optimize import Settings
    from cnca.run import Request

    settings = Settings(
        prompt,
        tau,
        steps,
        views_per_step=views_per_step,
        learning_rate=learning_rate,
        full_overlap=full_overlap,
        seed=seed,
    )
    terminal.attack(
        Request(
            scene,
            detector,
            out,
            settings,
            backend=backend,
            generator=generator,
            efr=efr,
            samples=spp,
            tokens=tokens,
            guidance=guidance,
            held_out_views=held_out_views,
            resume=resume,
        )
    )


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Folder of the run.")] = Path("out/demo"),
    steps: Annotated[int, typer.Option(help="Updates of F_adv.")] = 30,
) -> None:
    """The main job on what ships with the package: a few minutes on two cores."""
    from cnca import terminal

    terminal.demo(out, steps)


@app.command("train-generator")
def train_generator(
    out: Annotated[Path, typer.Option(help="Folder for the pipeline.")],
    seed: Annotated[int, typer.Option(help="Seed of everything random.")] = 0,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with an interrupted run.")
    ] = False,
) -> None:
    """Train the shipped diffusion pipeline on procedural textures."""
    from cnca.gen.train import train_generator

    train_generator(out, seed=seed, resume=resume)


@app.command("train-detector")
def train_detector(
    out: Annotated[Path, typer.Option(help="Folder for pictures and weights.")],
    pictures: Annotated[int, typer.Option(help="Pictures to render.")] = 1680,
    epochs: Annotated[int, typer.Option(help="Passes over the pictures.")] = 26,
    seed: Annotated[int, typer.Option(help="Seed of everything random.")] = 0,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with an interrupted run.")
    ] = False,
) -> None:
    """Render pictures of the built-in vehicles and train the built-in detector on them."""
    from cnca.detector_data import train_builtin

    typer.echo(train_builtin(out, pictures=pictures, epochs=epochs, seed=seed, resume=resume))


def main() -> None:
    """Run the command line; bad input ends with one line on stderr and exit code 2."""
    # torch's idle threads spin by default, on the cores that Dr.Jit's threads then need.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    try:
        app(prog_name="cnca")
    except Exception as error:
        message = _user_message(error)
        if message is None:
            raise
        print(f"error: {message}", file=sys.stderr)
        raise SystemExit(2) from None


def _user_message(error: Exception) -> str | None:
    """The one line to show for ``error``, or None if it is a bug that deserves its traceback."""
    if isinstance(error, CncaError):
        return " ".join(str(error).split())
    pydantic = sys.modules.get("pydantic")  # who has not imported it cannot have raised its error
    if pydantic is not None and isinstance(error, pydantic.ValidationError):
        places = (
            f"{'.'.join(map(str, one['loc']))}: {one['msg']}, got {one['input']!r}"
            for one in error.errors()
        )
        return f"{error.title}: " + "; ".join(places)
    return None
