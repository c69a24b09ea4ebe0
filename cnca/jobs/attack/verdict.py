"""What an attack is worth: its texture and its controls, on held-out views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace

import torch
from rich.console import Console

from cnca import build
from cnca.attack.best import Validation
from cnca.attack.loop import Progress
from cnca.attack.parts import Attack
from cnca.attack.settings import FEATURE, Settings
from cnca.attack.targets import Target
from cnca.attack.variables import origin
from cnca.core.detections import ALARM
from cnca.core.images import write_texture_srgb
from cnca.core.manifest import write_json
from cnca.core.pictures import SrgbPicture, as_pictures, draw_boxes, side_by_side, write_png
from cnca.core.progress import bar
from cnca.core.records import as_json
from cnca.core.types import SrgbImages, SrgbTexture
from cnca.gen.feature import StoredFeature
from cnca.jobs.attack.request import Request
from cnca.judge.evaluate import Result, evaluate
from cnca.judge.held_out import held_out_shots
from cnca.judge.summary import Summary, TextureScores, WeightedScores
from cnca.report import shown_views, write_report
from cnca.scene import controls


def judge(request: Request, attack: Attack, progress: Progress, console: Console) -> Summary:
    """Judge on held-out views and write everything; returns the summary."""
    settings, scene, out = request.settings, attack.scene, request.out
    latents, before = progress.result, origin(attack.generator, settings)
    texture, unattacked = (
        made.texture(attack.generator, settings.prompt, settings.seed) for made in (latents, before)
    )
    textures = {
        "before": None,
        "prompt": unattacked,
        **control_textures(attack, texture, settings.seed),
        "after": texture,
    }
    if request.control_seeds:
        textures["seeds"] = best_of_seeds(attack, settings, request.control_seeds)
    albedos = {name: attack.paint.apply(painted) for name, painted in textures.items()}
    shots = held_out_shots(scene, request.held_out_views, settings.seed)
    # The path tracer, whatever backend the loop has.  What lies around the vehicle is seen beside
    # its plain paint, once for all textures.
    vehicle, samples = build.build_vehicle(scene), scene.image.samples
    renderer = build.build_loop_renderer(
        scene, vehicle, attack.paint, backend="mitsuba", samples=samples
    )
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
    summary = _summarize(request, attack.targets, results, progress)
    write_json(out / "summary.json", as_json(summary))
    write_report(out)
    return summary


def control_textures(attack: Attack, texture: SrgbTexture, seed: int) -> dict[str, SrgbTexture]:
    """What the camouflage must be stronger than, with its palette or without; see ``controls``."""
    rng, mask = torch.Generator().manual_seed(seed), attack.paint.mask
    on_car = attack.paint.resize(texture)
    return {
        "random": controls.random_blocks(mask.shape[-1], rng),
        "shuffled": controls.shuffled(on_car, rng, mask=mask),
        "mirrored": controls.mirrored(on_car, rng, mask),
        "mean": controls.mean_color(on_car, mask),
    }


def best_of_seeds(attack: Attack, settings: Settings, count: int) -> SrgbTexture:
    """Of ``count`` other seeds' textures, without an attack, the one that detectors see worst.

    They are compared on the validation views, which judge nothing: what luck alone comes to.
    """
    generator, prompt = attack.generator, settings.prompt
    validation = Validation(attack, settings, generator.encode(prompt))
    textures = []
    for seed in range(settings.seed + 1, settings.seed + 1 + count):
        made = origin(generator, replace(settings, seed=seed)).texture(generator, prompt, seed)
        textures.append((validation.look_at(made).loss_adv, made))
    return min(textures, key=lambda pair: pair[0])[1]


def _before_after(results: dict[str, Result], target: Target) -> SrgbPicture:
    """Rows: plain paint and camouflage; columns: views spread over the held-out set.

    Nothing is written into it: the report sets the scores beside the pictures.
    """
    tiles = []
    for name in ("before", "after"):
        result = results[name]
        for i in shown_views(len(result.images)):
            sure = result.detections[i].above(ALARM)
            picture = as_pictures(SrgbImages(result.images[i : i + 1]))[0]
            tiles.append(draw_boxes(picture, sure, target.detector.class_names, result.boxes[i]))
    return side_by_side(tiles, columns=len(tiles) // 2)


def _summarize(
    request: Request,
    targets: Sequence[Target],
    results: dict[str, dict[str, Result]],
    progress: Progress,
) -> Summary:
    """The numbers of the first target, then those of each by name."""
    by_target = {t.name: scores_of(results[t.name], t.weight) for t in targets}
    first = targets[0].name
    numbers = {f.name: getattr(by_target[first], f.name) for f in fields(TextureScores)}
    return Summary(
        prompt=request.settings.prompt,
        detector=first,
        scene=str(request.scene),
        held_out_views=len(results[first]["before"].scores),
        detectors=by_target,
        steps=progress.step,
        best_step=progress.best.step if request.settings.check_every else None,
        **numbers,
    )


def scores_of(results: dict[str, Result], weight: float) -> WeightedScores:
    """What a detector of this weight in the loss sees of every texture."""
    scores = {name: round(result.mean_score, 4) for name, result in results.items()}
    others = min(score for name, score in scores.items() if name != "after")
    return WeightedScores(
        weight=weight,
        ratio_to_shuffled=round(scores["after"] / max(scores["shuffled"], 1e-9), 4),
        ratio_to_controls=round(scores["after"] / max(others, 1e-9), 4),
        average_precision={n: round(r.average_precision, 4) for n, r in results.items()},
        scores_per_view={n: [round(s, 4) for s in r.scores] for n, r in results.items()},
        **{f"score_{name}": score for name, score in scores.items()},
    )
