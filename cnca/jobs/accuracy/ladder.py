"""What accuracy costs in time: a ladder of plans against a converged reference of one view."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console

from cnca import build
from cnca.core.errors import RunError
from cnca.core.manifest import hashes, versions, write_json
from cnca.core.progress import bar
from cnca.core.records import as_json, read_record
from cnca.core.run_folder import RunFolder
from cnca.core.types import LinearImages
from cnca.detect import detector_files
from cnca.effects.catalog import EFFECTS
from cnca.effects.effect import Model, Numbered
from cnca.effects.explain import explain
from cnca.effects.plan import Demand
from cnca.jobs.accuracy.delta_e import mean_delta_e
from cnca.jobs.accuracy.fidelity import (
    gradient_agreement,
    mean_bias,
    root,
    squared_bias,
    squared_error,
    squared_noise,
)
from cnca.jobs.accuracy.figure import Still, draw_figure, seconds_of, shown_rungs
from cnca.jobs.accuracy.price_list import write_table
from cnca.jobs.accuracy.records import (
    AccuracyReport,
    MeasuredRung,
    PassSeconds,
    ReferenceRecord,
    RungSeconds,
)
from cnca.jobs.accuracy.reference import Bench, Reference, agreement, converge, fingerprint
from cnca.jobs.accuracy.request import AccuracyRequest
from cnca.scene.load_scene import load_scene
from cnca.scene.views import choose_views

TARGETS = (0.01, 0.02, 0.05, 0.10)
"""Errors whose plans are marked."""
REPEATS = 3
"""Renders of each rung."""
REFERENCE_SHARE = 0.4
"""The largest share of the budget that the reference takes."""


@dataclass(frozen=True)
class Rung:
    """One step of the ladder."""

    name: str
    demand: Demand
    scale: float = 1.0
    """Share of the picture's sides that is rendered; the rest is interpolated."""
    target: float | None = None
    """The error that was asked for."""


def ladder() -> Iterator[Rung]:
    """What the plan chooses; samples × reflections; other models and resolutions."""
    for target in TARGETS:
        yield Rung(f"plan for {target:.0%}", Demand(target), target=target)
    named = [effect for effect in EFFECTS.values() if not isinstance(effect, Numbered)]
    for samples in (1, 4, 16, 64, 256):
        usual: dict[str, Model] = {"samples": samples}
        for bounces in (1, 2, 3):
            demand = Demand(forced={**usual, "interreflection": bounces})
            yield Rung(f"{samples} spp, {bounces} reflections", demand)
        for effect in named:
            for model in effect.compared:
                demand = Demand(forced={**usual, effect.name: model})
                yield Rung(f"{samples} spp, {effect.name} {model}", demand)
        yield Rung(f"{samples} spp, half resolution", Demand(forced=usual), scale=0.5)


def measure(bench: Bench, rung: Rung, reference: Reference) -> MeasuredRung:
    """Processor seconds and errors of one rung; the first call makes kernels and solves the fog."""
    plan = bench.plan(rung.demand)
    predicted = explain(plan)[-1].error
    if rung.target is None:
        shots = [bench.shoot(rung.demand, repeat, rung.scale) for repeat in range(REPEATS)]
    else:
        aimed = [bench.aim(rung.target, repeat) for repeat in range(REPEATS)]
        shots, plan = [shot[:3] for shot in aimed], aimed[-1][3]
    images, gradients, seconds = zip(*shots, strict=True)
    first, second = reference.picture_halves()
    halves = (bench.pixels(first), bench.pixels(second))
    pictures = [bench.pixels(image) for image in images]
    pairs = [(pictures[i], pictures[i - 1]) for i in range(REPEATS)]
    squares = [squared_error(picture, halves) for picture in pictures]
    bias, uncertainty = np.mean([squared_bias(pair, halves) for pair in pairs], axis=0)
    mean, mean_error = mean_bias(pictures, halves)
    truth = bench.score(LinearImages((first + second) / 2))
    agreements = [gradient_agreement(g, reference.gradient_halves()) for g in gradients]
    cosine, length = np.mean(agreements, axis=0)
    return MeasuredRung(
        name=rung.name,
        target=rung.target,
        models=dict(plan.models),
        scale=rung.scale,
        predicted_error=predicted,
        seconds=RungSeconds(seconds[0], _fastest(seconds[1:])),
        error=root(float(np.mean([square for square, _ in squares]))),
        bias=root(float(bias)),
        bias_hidden=root(float(2 * uncertainty)),
        mean=mean,
        mean_error=mean_error,
        noise=root(float(np.mean([squared_noise(pair, halves) for pair in pairs]))),
        delta_e=float(np.mean([mean_delta_e([p], halves) for p in pictures])),
        gradient_cosine=float(cosine),
        gradient_length=float(length),
        score_change=float(np.mean([abs(bench.score(i) - truth) for i in images])),
    )


def accuracy(request: AccuracyRequest, console: Console) -> AccuracyReport:
    """Measure the ladder on one view; write ``accuracy.json``, ``.md`` and ``.png`` into ``out``.

    The same call goes on where an earlier one was interrupted or ran out of time.

    Raises:
        RunError: ``volpath`` for a scene without fog.
    """
    scene_file, out, seconds = request.scene, request.out, request.seconds
    detector, volpath = request.detector, request.volpath
    started = time.process_time()
    scene = load_scene(scene_file)
    if volpath and (scene.fog is None or scene.fog.height == 0):
        raise RunError(f"{scene_file}: --volpath is for fog, and the scene has none; leave it out")
    bench = Bench(scene, choose_views(scene, request.view)[0], build.build_detector(detector))
    key = fingerprint(scene, bench.view, volpath=volpath)
    inputs = [*build.scene_files(scene, scene_file), *detector_files(detector)]
    RunFolder(out, "accuracy").renew(request, hashes(inputs))
    rungs = _known_rungs(out, key, detector)
    reference = converge(
        bench,
        out / f"reference_{key}.pt",
        started + REFERENCE_SHARE * seconds,
        volpath=volpath,
        console=console,
    )
    report = AccuracyReport(
        scene=str(scene_file),
        view=bench.view,
        detector=detector,
        reference=ReferenceRecord(**asdict(agreement(bench, reference)), key=key, volpath=volpath),
        versions=versions(),
        rungs=rungs,
    )
    known, pace = {rung.name for rung in report.rungs}, 0.0
    with bar(console) as progress:
        for rung, rays in progress.track(_by_rays(bench), description="rungs"):
            if rung.name in known:
                continue
            begun = time.process_time()
            if begun + pace * rays > started + seconds:
                report.not_reached.append(rung.name)
                continue
            report.rungs.append(measure(bench, rung, reference))
            write_json(out / "accuracy.json", as_json(report))
            pace = (time.process_time() - begun) / rays
    report = replace(report, front=pareto_front(report.rungs))
    write_json(out / "accuracy.json", as_json(report))
    write_table(out / "accuracy.md", report)
    draw_figure(out / "accuracy.png", report, stills(bench, report, reference))
    return report


def stills(bench: Bench, report: AccuracyReport, reference: Reference) -> list[Still]:
    """Pictures of some rungs of the front, and of the reference."""
    first, second = reference.picture_halves()
    truth = LinearImages((first + second) / 2)
    shown = []
    for rung in shown_rungs(report):
        if rung.target is None:
            name = rung.name.replace(" spp", " rays")
            image, _, _ = bench.shoot(Demand(forced=dict(rung.models)), 0, rung.scale)
        else:
            name = f"{rung.target:.0%} asked"
            image, *_ = bench.aim(rung.target, 0)
        caption = f"{name}\n{seconds_of(rung):.2f} s, error {rung.error:.1%}"
        shown.append(bench.still(image, caption, truth))
    spent = f"{report.reference.seconds:.0f} s, {report.reference.samples} rays"
    return [*shown, bench.still(truth, f"reference\n{spent}", None)]


def pareto_front(rungs: Sequence[MeasuredRung]) -> list[str]:
    """Names of the rungs that no faster one beats in error, fastest first."""
    front: list[str] = []
    least = float("inf")
    for rung in sorted(rungs, key=lambda rung: rung.seconds.steady.forward):
        if rung.error < least:
            least = rung.error
            front.append(rung.name)
    return front


def _by_rays(bench: Bench) -> list[tuple[Rung, float]]:
    """Rungs that differ in this scene and their rays per pixel, fewest first."""
    different: dict[object, tuple[Rung, float]] = {}
    for rung in ladder():
        plan = bench.plan(rung.demand)
        key = (tuple(plan.models.items()), rung.scale, rung.target)
        # Without fog, no fog can be left out: the usual models stand for that rung.
        different.setdefault(key, (rung, plan.samples * rung.scale**2))
    return sorted(different.values(), key=lambda pair: pair[1])


def _fastest(seconds: Sequence[PassSeconds]) -> PassSeconds:
    return PassSeconds(min(s.forward for s in seconds), min(s.backward for s in seconds))


def _known_rungs(out: Path, key: str, detector: str) -> list[MeasuredRung]:
    """Rungs of an earlier call that were measured against the same reference."""
    path = out / "accuracy.json"
    if not path.exists():
        return []
    report = read_record(AccuracyReport, path, advice="delete it to measure all rungs again")
    same = report.reference.key == key and report.detector == detector
    return report.rungs if same else []
