"""One ``cnca optimize`` from start to report: its folder, its checkpoints, its verdict.

A run folder holds ``manifest.json``, ``log.jsonl``, ``checkpoint.pt``, until the end also
``texture_now.png`` and ``views_now.png`` of a late step, and at the end ``texture.png``,
``F_adv.safetensors``, ``summary.json``, ``before_after.png`` and ``report.html``.
"""

from __future__ import annotations

import json
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

from rich.console import Console

from cnca import build
from cnca.attack import checkpoint
from cnca.attack.loop import Progress, optimize, start
from cnca.attack.objectives import load_objective
from cnca.attack.parts import Attack
from cnca.attack.records import StepRecord
from cnca.attack.style import Style, style_of
from cnca.attack.targets import parse_targets, refuse_black_boxes
from cnca.attack.variables import origin
from cnca.core import parallel
from cnca.core.files import append_text, write_text
from cnca.core.manifest import hashes
from cnca.core.progress import bar
from cnca.core.records import as_json
from cnca.core.run_folder import RunFolder
from cnca.gen.scorer import load_scorer
from cnca.jobs.attack import tensorboard
from cnca.jobs.attack.budget import decided
from cnca.jobs.attack.now import Display
from cnca.jobs.attack.pattern import at_size
from cnca.jobs.attack.request import JOB, Request
from cnca.jobs.attack.verdict import judge
from cnca.judge.summary import Summary
from cnca.scene.load_scene import load_scene
from cnca.scene.protocols import TextureGenerator
from cnca.scene.schema import Scene

CHECKPOINT = "checkpoint.pt"


def run(request: Request, console: Console) -> Summary:
    """Attack, judge on held-out views, write everything; returns the summary.

    Raises:
        RunError: the folder holds another run, or one that is not to be resumed.
    """
    if request.tensorboard:
        tensorboard.need_tensorboard()
    scene = load_scene(request.scene)
    attack = assemble(request, scene)
    request = decided(request, attack)
    progress = start(attack, request.settings)
    parallel.by_first(lambda: _claim(request, scene, console))
    if (request.out / CHECKPOINT).exists():
        checkpoint.restore(progress, request.out / CHECKPOINT)
    _attack(request, attack, progress, console)
    return parallel.by_first(lambda: _finish(request, attack, progress, console))


def _finish(request: Request, attack: Attack, progress: Progress, console: Console) -> Summary:
    summary = judge(request, attack, progress, console)
    Display(request.out).remove()
    return summary


def assemble(request: Request, scene: Scene) -> Attack:
    """The parts of the attack that the request names; raises DetectorError for black boxes."""
    targets = build.build_targets(request.detectors, scene.vehicle.label)
    refuse_black_boxes(targets)
    vehicle = build.build_vehicle(scene)
    paint = build.build_paint(scene, vehicle)
    generator = at_size(request, build_generator(request), vehicle)
    return Attack(
        scene=scene,
        renderer=build.build_loop_renderer(
            scene, vehicle, paint, backend=request.backend, samples=request.samples
        ),
        paint=paint,
        generator=generator,
        targets=targets,
        objective=load_objective(request.objective, full_overlap=request.full_overlap),
        residual=build.build_residual(request.efr),
        style=build_style(request, generator),
    )


def build_style(request: Request, generator: TextureGenerator) -> Style | None:
    """The style term of the request, by the shipped scorer; None for a weight of 0.

    Raises GeneratorError where the scorer knows no word of the prompt.
    """
    if request.style == 0:
        return None
    settings = request.settings
    unattacked = origin(generator, settings).texture(generator, settings.prompt, settings.seed)
    return style_of(load_scorer(), settings.prompt, unattacked, request.style)


def build_generator(request: Request) -> TextureGenerator:
    """The generator that the request names."""
    return build.build_generator(
        request.generator,
        feature=request.settings.feature,
        size=request.texture_size,
        steps=request.ddim_steps,
        tokens=request.tokens,
        guidance=request.guidance,
        gradient_steps=request.gradient_steps,
        gradient_checkpointing=request.gradient_checkpointing,
        device=request.device,
        mixed_precision=request.mixed_precision,
    )


def claim(request: Request, scene: Scene, *, resume: bool) -> dict[str, tuple[str, str]]:
    """Begin the run's folder, or see that it holds this run; see :meth:`RunFolder.claim`."""
    names, parts = parse_targets(request.detectors), (request.backend, request.objective)
    inputs = build.input_files(scene, request.scene, names, request.generator, request.efr, parts)
    return RunFolder(request.out, JOB).claim(request.as_dict(), hashes(inputs), resume=resume)


def _claim(request: Request, scene: Scene, console: Console) -> None:
    for package, (then, now) in claim(request, scene, resume=request.resume).items():
        console.print(f"begun with {package} {then}, goes on with {now}: not bit for bit the same")


def _attack(request: Request, attack: Attack, progress: Progress, console: Console) -> None:
    log, display = request.out / "log.jsonl", Display(request.out)
    if parallel.rank() == 0:
        _keep_lines(log, progress.step)
    with bar(console) as shown, _board(request, progress) as board:
        task = shown.add_task("attack", total=request.settings.steps, completed=progress.step)

        def after_step(progress: Progress, record: StepRecord) -> None:
            if parallel.rank() == 0:
                append_text(log, json.dumps(as_json(record)) + "\n")
                board(record)
                if progress.seen is not None:
                    display.show(*progress.seen)
                checkpoint.save(progress, request.out / CHECKPOINT)
            label = f"attack: L_adv {record.loss_adv:.3f}, D_s {record.D_s:.3f}"
            shown.update(task, completed=progress.step, description=label)

        optimize(attack, request.settings, progress, after_step)


def _board(request: Request, progress: Progress) -> AbstractContextManager[tensorboard.Log]:
    if not request.tensorboard or parallel.rank() > 0:
        return nullcontext(lambda _record: None)
    return tensorboard.logging_to(request.out / "tensorboard", progress.step)


def _keep_lines(log: Path, count: int) -> None:
    """Drop records of steps that the checkpoint does not know: they are done again."""
    if log.exists():
        lines = log.read_text(encoding="utf-8").splitlines(keepends=True)[:count]
        write_text(log, "".join(lines))
