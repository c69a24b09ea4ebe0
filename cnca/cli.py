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
    volpath: Annotated[
        bool, typer.Option("--volpath", help="Fog's reference by Mitsuba's volumetric path tracer.")
    ] = False,
) -> None:
    """Measure what accuracy costs in time; the same command goes on after an interruption."""
    from cnca import terminal

    terminal.accuracy(scene, out, seconds=seconds, view=view, detector=detector, volpath=volpath)


@app.command("accuracy-generator")
def accuracy_generator(
    out: Annotated[Path, typer.Option(help="Folder for table and picture.")],
    prompt: Annotated[str, typer.Option(help="What to paint.")] = "colorful camouflage",
    generator: Annotated[
        Path | None, typer.Option(help="Folder in diffusers format; by default the shipped one.")
    ] = None,
    feature: Annotated[str, typer.Option(help="concat or replace.")] = "concat",
    guidance: Annotated[float, typer.Option(help="Scale of classifier-free guidance.")] = 4.0,
    probes: Annotated[int, typer.Option(help="Gradients to average over.")] = 3,
    seed: Annotated[int, typer.Option(help="Seed of everything random.")] = 0,
) -> None:
    """Measure what going back through fewer denoising steps costs the gradient."""
    from cnca import terminal

    terminal.generator_accuracy(
        out,
        prompt=prompt,
        generator=generator,
        feature=feature,
        guidance=guidance,
        probes=probes,
        seed=seed,
    )


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
    detector: Annotated[
        str, typer.Option(help="builtin, or a file: see docs/detectors.md.")
    ] = "builtin",
    backend: Annotated[str, typer.Option(help="Renderer.")] = "mitsuba",
    tau: Annotated[
        str, typer.Option(help="Bound on each element of F_adv; inf for none, auto to search it.")
    ] = "1.0",
    min_prompt_score: Annotated[
        float | None, typer.Option(help="With --tau auto: cosine that the texture must keep.")
    ] = None,
    scorer: Annotated[
        Path | None, typer.Option(help="With --tau auto: prompt scorer, or a CLIP folder.")
    ] = None,
    steps: Annotated[int, typer.Option(help="Updates of F_adv.")] = 100,
    views_per_step: Annotated[int, typer.Option(help="Pictures per update.")] = 8,
    learning_rate: Annotated[float, typer.Option(help="Step size.")] = 0.01,
    decay: Annotated[
        bool, typer.Option("--decay", help="Let it fall to 0 along a cosine.")
    ] = False,
    update: Annotated[str, typer.Option(help="adam, or sign for signed steps.")] = "adam",
    full_overlap: Annotated[
        float, typer.Option(help="IoU from which a box counts in full; 1 is the paper's loss.")
    ] = 1.0,
    generator: Annotated[
        Path | None, typer.Option(help="Folder in diffusers format; by default the shipped one.")
    ] = None,
    efr: Annotated[Path | None, typer.Option(help="Trained EFR that corrects renders.")] = None,
    feature: Annotated[
        str, typer.Option(help="concat (the paper) or replace (its released code).")
    ] = "concat",
    tokens: Annotated[
        int | None, typer.Option(help="Tokens of F_adv; by default 77, or 40 that are replaced.")
    ] = None,
    guidance: Annotated[float, typer.Option(help="Scale of classifier-free guidance.")] = 4.0,
    gradient_steps: Annotated[
        int | None, typer.Option(help="Go back through the last K denoising steps; default all.")
    ] = None,
    device: Annotated[str, typer.Option(help="Where the generator works, cpu or cuda.")] = "cpu",
    mixed_precision: Annotated[
        bool, typer.Option("--mixed-precision", help="U-Net in bfloat16 (autocast).")
    ] = False,
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
        steps=steps,
        views_per_step=views_per_step,
        learning_rate=learning_rate,
        decay=decay,
        update=update,
        full_overlap=full_overlap,
        seed=seed,
        feature=feature,
    )
    request = Request(
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
        gradient_steps=gradient_steps,
        device=device,
        mixed_precision=mixed_precision,
        held_out_views=held_out_views,
        resume=resume,
    )
    terminal.optimize(request, tau, min_prompt_score, scorer)


_Scene = Annotated[Path, typer.Option(help="Scene file.")]
_Out = Annotated[Path, typer.Option(help="Folder of the table; a rerun goes on in it.")]
_Detector = Annotated[str, typer.Option(help="builtin, or a file: see docs/detectors.md.")]
_Scorer = Annotated[Path | None, typer.Option(help="Of cnca train-scorer, or a CLIP folder.")]
_Steps = Annotated[int, typer.Option(help="Updates of F_adv in each run.")]
_Views = Annotated[int, typer.Option(help="Pictures per update.")]
_Rate = Annotated[float, typer.Option(help="Step size.")]
_Overlap = Annotated[float, typer.Option(help="IoU from which a box counts in full.")]
_Feature = Annotated[str, typer.Option(help="concat (the paper) or replace (its released code).")]
_Generator = Annotated[Path | None, typer.Option(help="Folder in diffusers format.")]
_HeldOut = Annotated[int, typer.Option(help="Views that judge each result.")]
_Seed = Annotated[int, typer.Option(help="Seed of everything random.")]


@app.command()
def tradeoff(
    scene: _Scene,
    prompt: Annotated[str, typer.Option(help="What the paint is to look like.")],
    out: _Out,
    taus: Annotated[str, typer.Option(help="Bounds on F_adv to compare.")] = "0.1,0.5,1,1.5,inf",
    detector: _Detector = "builtin",
    scorer: _Scorer = None,
    steps: _Steps = 100,
    views_per_step: _Views = 8,
    learning_rate: _Rate = 0.01,
    full_overlap: _Overlap = 1.0,
    feature: _Feature = "concat",
    generator: _Generator = None,
    held_out_views: _HeldOut = 24,
    seed: _Seed = 0,
) -> None:
    """Attack under several bounds τ: the paper's table of naturalness against strength."""
    from cnca import terminal
    from cnca.optimize import Settings
    from cnca.run import Request

    settings = Settings(
        prompt,
        steps=steps,
        views_per_step=views_per_step,
        learning_rate=learning_rate,
        full_overlap=full_overlap,
        seed=seed,
        feature=feature,
    )
    request = Request(
        scene, detector, out, settings, generator=generator, held_out_views=held_out_views
    )
    terminal.tradeoff(request, taus, scorer)


@app.command()
def prompts(
    wanted: Annotated[list[str], typer.Argument(help="Prompts to compare.")],
    scene: _Scene,
    out: _Out,
    tau: Annotated[str, typer.Option(help="Bound on each element of F_adv.")] = "1.0",
    detector: _Detector = "builtin",
    scorer: _Scorer = None,
    steps: _Steps = 100,
    views_per_step: _Views = 8,
    learning_rate: _Rate = 0.01,
    full_overlap: _Overlap = 1.0,
    feature: _Feature = "concat",
    generator: _Generator = None,
    held_out_views: _HeldOut = 24,
    seed: _Seed = 0,
) -> None:
    """Attack with several prompts: the paper's table of styles, with numbers and pictures."""
    from cnca import terminal
    from cnca.optimize import Settings
    from cnca.run import Request

    settings = Settings(
        wanted[0],
        steps=steps,
        views_per_step=views_per_step,
        learning_rate=learning_rate,
        full_overlap=full_overlap,
        seed=seed,
        feature=feature,
    )
    request = Request(
        scene, detector, out, settings, generator=generator, held_out_views=held_out_views
    )
    terminal.prompts(request, wanted, tau, scorer)


@app.command()
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
    generator: Annotated[
        Path | None, typer.Option(help="Folder in diffusers format; by default the shipped one.")
    ] = None,
    no_controls: Annotated[
        bool, typer.Option("--no-controls", help="Only the normal paint beside the textures.")
    ] = False,
    spp: Annotated[int | None, typer.Option(help="Rays per pixel instead of the scene's.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of everything random.")] = 0,
) -> None:
    """Measure AP@0.5 of textures against controls, with confidence intervals."""
    from cnca import terminal
    from cnca.candidates import CONTROLS
    from cnca.evidence_parts import Request

    detectors = tuple(detector or ["builtin"])
    if photos is not None or labels is not None:
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


@app.command("render-dataset")
def render_dataset(
    scene: Annotated[Path, typer.Option(help="Scene file.")],
    out: Annotated[Path, typer.Option(help="Folder; the same command goes on in it.")],
    images: Annotated[int | None, typer.Option(help="Pictures; by default the whole grid.")] = None,
    shard: Annotated[str, typer.Option(help="Which part to render, such as 2/4.")] = "1/1",
    tar: Annotated[bool, typer.Option("--tar", help="Pack WebDataset tars, too.")] = False,
    spp: Annotated[int | None, typer.Option(help="Rays per pixel instead of the scene's.")] = None,
) -> None:
    """Render 16 weathers, poses and colours with COCO annotations, masks, poses and weather."""
    from cnca import terminal

    terminal.dataset(scene, out, images=images, shard=shard, tar=tar, samples=spp)


@app.command("reorder-uv")
def reorder_uv(
    mesh: Annotated[str, typer.Argument(help="Mesh file, or builtin:NAME.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="OBJ file to write.")],
    up: Annotated[str, typer.Option(help="The file's upward axis.")] = "y",
    front: Annotated[str, typer.Option(help="The file's forward axis.")] = "+x",
    scale: Annotated[float, typer.Option(help="Metres per unit of the file.")] = 1.0,
    paint_mask: Annotated[Path | None, typer.Option(help="White where there is paint.")] = None,
    base_texture: Annotated[Path | None, typer.Option(help="The car's own texture.")] = None,
    size: Annotated[int, typer.Option(help="Texels per side of carried textures.")] = 2048,
) -> None:
    """Lay out a vehicle's UVs so that its painted outside is connected, and compare."""
    from cnca import terminal
    from cnca.reorder_uv import Source

    terminal.reorder_uv(Source(mesh, up, front, scale, paint_mask, base_texture), out, size)


@app.command("import-carla")
def import_carla(
    folder: Annotated[Path, typer.Argument(help="Folder of .npz frames.")],
    out: Annotated[Path, typer.Option(help="Folder for the data set.")],
    scene: Annotated[Path, typer.Option(help="Scene file with the frames' vehicle.")] = Path(
        "scenes/etron_carla.yaml"
    ),
    fov: Annotated[float, typer.Option(help="Horizontal field of view in degrees.")] = 90.0,
) -> None:
    """Turn CARLA frames into a labelled data set, and say how well the mesh meets them."""
    from cnca import terminal

    terminal.import_carla(folder, out, scene, fov=fov)


@app.command()
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
    spp: Annotated[int | None, typer.Option(help="Rays per pixel instead of the scene's.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of everything random.")] = 0,
) -> None:
    """Make the paper's Table 1: AP@0.5 of its methods' textures over its grid of views."""
    from cnca import terminal
    from cnca.evidence_parts import Request

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


@app.command("train-efr")
def train_efr(
    out: Annotated[Path, typer.Option(help="Weights to write, .safetensors; report beside.")],
    from_render: Annotated[
        list[Path] | None, typer.Option(help="Scene file to draw pairs from; repeatable.")
    ] = None,
    carla: Annotated[Path | None, typer.Option(help="Folder of CARLA frames instead.")] = None,
    carla_scene: Annotated[Path, typer.Option(help="Scene file with their vehicle.")] = Path(
        "scenes/etron_carla.yaml"
    ),
    backend: Annotated[str, typer.Option(help="Renderer to correct.")] = "raster",
    spp: Annotated[int, typer.Option(help="Its rays per pixel.")] = 4,
    views: Annotated[int, typer.Option(help="Views to train on, each in six paints.")] = 64,
    epochs: Annotated[int, typer.Option(help="Passes over them.")] = 20,
    seed: Annotated[int, typer.Option(help="Seed of everything random.")] = 0,
) -> None:
    """Train an EFR that corrects cheap renders towards path-traced ones or photographs."""
    from cnca import terminal

    terminal.train_efr(
        out,
        scenes=from_render or [],
        carla=carla,
        carla_scene=carla_scene,
        backend=backend,
        samples=spp,
        views=views,
        epochs=epochs,
        seed=seed,
    )


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Folder of the run.")] = Path("out/demo"),
    steps: Annotated[int, typer.Option(help="Updates of F_adv.")] = 80,
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


@app.command("train-scorer")
def train_scorer(
    out: Annotated[Path, typer.Option(help="Folder for the scorer.")],
    corpus: Annotated[
        Path, typer.Option(help="Folder of train-generator, for its pictures.")
    ] = Path("out/generator"),
    seed: Annotated[int, typer.Option(help="Seed of everything random.")] = 0,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with an interrupted run.")
    ] = False,
) -> None:
    """Train the shipped prompt scorer on procedural textures, and test it on unseen ones."""
    from cnca.gen.train_scorer import train_scorer

    trained = train_scorer(out, data=corpus, seed=seed, resume=resume)
    typer.echo(f"{trained.file}: right prompt of ten in {trained.right:.1%} of {trained.pictures}")


@app.command("train-detector")
def train_detector(
    out: Annotated[Path, typer.Option(help="Folder for pictures and weights.")],
    kind: Annotated[str, typer.Option(help="yolo, anchor-free or transformer.")] = "yolo",
    pictures: Annotated[int, typer.Option(help="Pictures to render.")] = 1680,
    epochs: Annotated[int, typer.Option(help="Passes over the pictures.")] = 26,
    seed: Annotated[int, typer.Option(help="Seed of everything random.")] = 0,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with an interrupted run.")
    ] = False,
) -> None:
    """Render pictures of the built-in vehicles and train a built-in detector on them."""
    from cnca.detector_data import train_builtin

    report = train_builtin(
        out, kind=kind, pictures=pictures, epochs=epochs, seed=seed, resume=resume
    )
    typer.echo(report)


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
