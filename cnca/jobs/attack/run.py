"""One ``cnca optimize`` from start to report: its folder, its checkpoints, its verdict.

A run folder holds ``manifest.json``, ``log.jsonl``, ``checkpoint.pt``, and at the end
``texture.png``, ``F_adv.safetensors``, ``summary.json``, ``before_after.png`` and ``report.html``.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

import torch
from rich.console import Console

from cnca import build
from cnca.attack import checkpoint
from cnca.attack.loop import Progress, optimize, start
from cnca.attack.objectives import load_objective
from cnca.attack.parts import Attack
from cnca.attack.settings import FEATURE
from cnca.attack.style import Style, style_of
from cnca.attack.targets import Target, parse_targets, refuse_black_boxes
from cnca.attack.variables import origin
from cnca.core import parallel
from cnca.core.detections import ALARM
from cnca.core.files import append_text, write_text
from cnca.core.images import write_texture_srgb
from cnca.core.manifest import hashes, write_json
from cnca.core.pictures import SrgbPicture, as_pictures, draw_boxes, side_by_side, write_png
from cnca.core.progress import bar
from cnca.core.run_folder import RunFolder
from cnca.gen.feature import StoredFeature
from cnca.gen.scorer import load_scorer
from cnca.jobs.attack import tensorboard
from cnca.jobs.attack.request import Request
from cnca.judge.evaluate import Result, Shots, evaluate
from cnca.report import shown_views, write_report
from cnca.scene import controls
from cnca.scene.protocols import TextureGenerator
from cnca.scene.schema import Scene, load_scene
from cnca.scene.variation import draw_views, draw_weathers, in_blocks

HELD_OUT_SEED = 104_729
"""Added to a run's seed for the views that judge it: never those that trained it."""
CHECKPOINT = "checkpoint.pt"
JOB = "optimize"
"""Which command's run the folder holds."""


def run(request: Request, console: Console) -> dict[str, Any]:
    """Attack, judge on held-out views, write everything; returns the summary.

    Raises:
        RunError: the folder holds another run, or one that is not to be resumed.
    """
    if request.tensorboard:
        tensorboard.need_tensorboard()
    scene = load_scene(request.scene)
    attack = assemble(request, scene)
    progress = start(attack, request.settings)
    parallel.by_first(lambda: _claim(request, scene, console))
    if (request.out / CHECKPOINT).exists():
        checkpoint.restore(progress, request.out / CHECKPOINT)
    _attack(request, attack, progress, console)
    return parallel.by_first(lambda: _judge(request, attack, progress, console))


def assemble(request: Request, scene: Scene) -> Attack:
    """The parts of the attack that the request names; raises DetectorError for black boxes."""
    targets = build.build_targets(request.detectors, scene.vehicle.label)
    refuse_black_boxes(targets)
    vehicle = build.build_vehicle(scene)
    paint = build.build_paint(scene, vehicle)
    generator = build_generator(request)
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
    log = request.out / "log.jsonl"
    if parallel.rank() == 0:
        _keep_lines(log, progress.step)
    with bar(console) as shown, _board(request, progress) as board:
        task = shown.add_task("attack", total=request.settings.steps, completed=progress.step)

        def after_step(progress: Progress, record: dict[str, Any]) -> None:
            if parallel.rank() == 0:
                append_text(log, json.dumps(record) + "\n")
                board(record)
                checkpoint.save(progress, request.out / CHECKPOINT)
            label = f"attack: L_adv {record['loss_adv']:.3f}, D_s {record['D_s']:.3f}"
            shown.update(task, completed=progress.step, description=label)

        optimize(attack, request.settings, progress, after_step)


def _board(request: Request, progress: Progress) -> AbstractContextManager[tensorboard.Log]:
    if not request.tensorboard or parallel.rank() > 0:
        return nullcontext(lambda record: None)
    return tensorboard.logging_to(request.out / "tensorboard", progress.step)


def _keep_lines(log: Path, count: int) -> None:
    """Drop records of steps that the checkpoint does not know: they are done again."""
    if log.exists():
        lines = log.read_text(encoding="utf-8").splitlines(keepends=True)[:count]
        write_text(log, "".join(lines))


def _judge(
    request: Request, attack: Attack, progress: Progress, console: Console
) -> dict[str, Any]:
    settings, scene, out = request.settings, attack.scene, request.out
    latents, before = progress.result, origin(attack.generator, settings)
    texture, unattacked = (
        made.texture(attack.generator, settings.prompt, settings.seed) for made in (latents, before)
    )
    size = scene.vehicle.texture_size
    chance = torch.Generator().manual_seed(settings.seed)
    albedos = {
        "before": attack.paint.apply(),
        "prompt": attack.paint.apply(unattacked),
        "random": attack.paint.apply(controls.random_blocks(size, chance)),
        "shuffled": attack.paint.apply(controls.shuffled(texture, chance)),
        "after": attack.paint.apply(texture),
    }
    shots = held_out_shots(scene, request.held_out_views, settings.seed)
    renderer = build.build_renderer(scene, build.build_vehicle(scene), backend=request.backend)
    with bar(console) as shown:
        task = shown.add_task("held-out views", total=len(albedos) * len(shots.weathers))
        results = evaluate(renderer, attack.targets, albedos, shots, lambda: shown.advance(task))
    write_texture_srgb(out / "texture.png", texture.permute(1, 2, 0).numpy())
    write_texture_srgb(out / "texture_prompt.png", unattacked.permute(1, 2, 0).numpy())
    tau, kind = settings.bound(FEATURE), settings.feature
    stored = StoredFeature(latents.feature, settings.prompt, tau, kind, latents.noises)
    stored.save(out / "F_adv.safetensors")
    first = attack.targets[0]
    write_png(out / "before_after.png", _before_after(results[first.name], first))
    summary = _summarize(request, attack.targets, results) | {"steps": progress.step}
    if settings.check_every:
        summary["best_step"] = progress.best.step
    write_json(out / "summary.json", summary)
    write_report(out)
    return summary


def held_out_shots(scene: Scene, count: int, seed: int) -> Shots:
    """Views and weathers of the scene's ranges that the attack with this seed does not see."""
    weathers = draw_weathers(scene, max(1, min(8, count // 4)), seed=seed + HELD_OUT_SEED)
    views = draw_views(scene, count, seed=seed + HELD_OUT_SEED)
    return Shots(in_blocks(views, len(weathers)), weathers, seed)


def _before_after(results: dict[str, Result], target: Target) -> SrgbPicture:
    """Rows: plain paint and camouflage; columns: views spread over the held-out set."""
    tiles, captions = [], []
    for name in ("before", "after"):
        result = results[name]
        for i in shown_views(len(result.images)):
            sure = result.detections[i].above(ALARM)
            picture = as_pictures(result.images[i : i + 1])[0]
            tiles.append(draw_boxes(picture, sure, target.detector.class_names, result.boxes[i]))
            captions.append(f"{name}: score {result.scores[i]:.2f}")
    return side_by_side(tiles, captions, columns=len(tiles) // 2)


def _summarize(
    request: Request, targets: Sequence[Target], results: dict[str, dict[str, Result]]
) -> dict[str, Any]:
    """The numbers of the first target, then those of each by name."""
    by_target = {t.name: {"weight": t.weight} | _numbers(results[t.name]) for t in targets}
    first = targets[0].name
    return {
        "prompt": request.settings.prompt,
        "detector": first,
        "scene": str(request.scene),
        "held_out_views": len(results[first]["before"].scores),
        **_numbers(results[first]),
        "detectors": by_target,
    }


def _numbers(results: dict[str, Result]) -> dict[str, Any]:
    scores = {name: round(result.mean_score, 4) for name, result in results.items()}
    return {
        **{f"score_{name}": score for name, score in scores.items()},
        "ratio_to_shuffled": round(scores["after"] / max(scores["shuffled"], 1e-9), 4),
        "AP@0.5": {name: round(r.average_precision, 4) for name, r in results.items()},
        "scores_per_view": {n: [round(s, 4) for s in r.scores] for n, r in results.items()},
    }
