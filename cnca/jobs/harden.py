"""``cnca harden``: a detector learns to find cars in the camouflages that were found against it.

Adversarial training (Madry et al. 2018) with pictures in place of a search in every step: the
built-in detector goes on learning on renders of the vehicle, half of them in the camouflages, half
in the paints of its first training.  The folder gets::

    pictures/               what it learns from
    detector/               the hardened detector, as ``--detector`` takes it, and its training
    views/                  the held-out views and what both detectors see in them
    hardening.json, .md     AP@0.5 and score before and after
    manifest.json           what all of it was made from
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console

from cnca import build
from cnca.core.errors import RunError
from cnca.core.files import write_text
from cnca.core.manifest import hashes, read_json, write_json
from cnca.core.progress import bar
from cnca.core.records import as_json
from cnca.core.run_folder import RunFolder
from cnca.detect import BUILTINS, detector_files
from cnca.jobs.evaluate.parts import build_eyes, build_stages
from cnca.jobs.evaluate.request import EvaluationRequest
from cnca.jobs.hardening_request import HardeningRequest
from cnca.judge.bootstrap import resample
from cnca.judge.candidates import Candidate, parse_candidates, read_candidate
from cnca.judge.records import Estimate
from cnca.judge.rows import NORMAL
from cnca.judge.stage import see
from cnca.judge.verdict import measure_all, word_for
from cnca.report.tables import cell, table
from cnca.scene.load_scene import load_scene
from cnca.scene.schema import Scene
from cnca.train.detector.renders import GROUPS, Cast, render_detector_data
from cnca.train.detector.training import DetectorReport, Settings, train_detector

BEFORE, AFTER = "before", "after"
MEASURES = {"AP_voc": "AP@0.5", "score": "score"}


@dataclass(frozen=True)
class Change:
    """A measure of one texture before the hardening and after it."""

    before: Estimate
    after: Estimate
    difference: Estimate
    verdict: str
    """See :func:`cnca.judge.verdict.word_for`."""


@dataclass(frozen=True)
class Hardening:
    """What a hardening has changed, over held-out views."""

    views: int
    rows: Mapping[str, Mapping[str, Change]]
    """Texture → measure → change."""
    training: DetectorReport


def harden(request: HardeningRequest, console: Console, *, resume: bool = False) -> Hardening:
    """Render, train, compare; returns what ``hardening.json`` holds.

    Raises:
        CncaError: a texture, scene or detector cannot be used, ``out`` holds a hardening already
            (without ``resume``) or one of other options, or there are too few pictures.
    """
    candidates = parse_candidates(request.textures)
    scene_file = request.scene or scene_of(candidates[0])
    evidence = EvaluationRequest(
        scenes=(scene_file,),
        out=request.out / "views",
        textures=request.textures,
        detectors=(f"{BEFORE}={request.detector}", f"{AFTER}={request.hardened}"),
        views=request.views,
        seed=request.seed,
    )
    settings = Settings(epochs=request.epochs, seed=request.seed, fine_tune=True)
    scene = load_scene(scene_file)
    # Refuses, before all else, what the detector cannot learn.
    build_eyes([request.detector], scene.vehicle.label)
    cast = make_cast(scene, candidates)
    inputs = [*build.scene_files(scene, scene_file), *detector_files(request.detector)]
    inputs += [candidate.picture for candidate in candidates]
    asked = {key: value for key, value in asdict(request).items() if key != "out"}
    RunFolder(request.out, "harden").claim(asked, hashes(inputs), resume=resume)
    pictures = request.out / "pictures"
    render_detector_data(pictures, pictures=request.pictures, seed=request.seed, cast=cast)
    training = train_detector(
        pictures,
        request.out / "detector",
        settings,
        template=BUILTINS[request.detector],
        resume=resume,
    )
    views, rows = compare(evidence, candidates, console)
    results = Hardening(views, rows, training)
    write_json(request.out / "hardening.json", as_json(results))
    write_text(request.out / "hardening.md", markdown(results))
    return results


def scene_of(candidate: Candidate) -> Path:
    """The scene of the run that found a texture; raises RunError where there is no such run."""
    manifest = candidate.picture.parent / "manifest.json"
    if not manifest.is_file():
        raise RunError(f"{candidate.picture}: no run's manifest.json beside it; give --scene")
    return Path(read_json(manifest)["request"]["scene"])


def make_cast(scene: Scene, candidates: Sequence[Candidate]) -> Cast:
    """The scene's vehicle, every other picture in a camouflage, the others in all paints."""
    vehicle = build.build_vehicle(scene)
    size = scene.vehicle.texture_size
    worn = {f"camouflage {c.name}": read_candidate(c, vehicle, size) for c in candidates}
    names, turns = list(worn), len(GROUPS) * len(worn)
    pairs = ((names[k % len(names)], GROUPS[k % len(GROUPS)]) for k in range(turns))
    groups = tuple(group for pair in pairs for group in pair)
    paint = build.build_paint(scene, vehicle)
    return Cast({vehicle.name: lambda: vehicle}, paint, groups, worn)


def compare(
    evidence: EvaluationRequest, candidates: Sequence[Candidate], console: Console
) -> tuple[int, dict[str, dict[str, Change]]]:
    """How many views there are, and what every texture's measures were and are."""
    stages = build_stages(evidence, candidates)
    eyes = build_eyes(evidence.detectors, stages[0].label)
    with bar(console) as shown:
        weathers = len(stages[0].rows) * len(stages[0].shots.weathers)
        task = shown.add_task("held-out views", total=weathers)
        seen = see(stages, eyes, lambda: shown.advance(task))
    truth = stages[0].truth()
    weights = resample([len(truth)], seed=evidence.seed)
    measured = measure_all(seen, truth, weights, normal=NORMAL)
    rows: dict[str, dict[str, Change]] = {}
    for row, by_detector in measured.items():
        before, after = (by_detector[name][stages[0].label] for name in (BEFORE, AFTER))
        rows[row] = {}
        for name in MEASURES:
            difference = after[name] - before[name]
            rows[row][name] = Change(
                before[name].estimate(),
                after[name].estimate(),
                difference.estimate(),
                word_for(difference, len(truth)),
            )
    return len(truth), rows


def markdown(results: Hardening) -> str:
    """The table of a hardening."""
    head = ["texture"]
    for measure in MEASURES.values():
        head += [f"{measure} before", "after", "verdict"]
    rows = []
    for row, by_measure in results.rows.items():
        line = [row]
        for change in by_measure.values():
            line += [cell(change.before, digits=2), cell(change.after, digits=2), change.verdict]
        rows.append(line)
    note = (
        f"{results.views} held-out views; in brackets 95 % bootstrap intervals over views. The "
        "verdict is on the difference over the same views.\n"
    )
    return table(head, rows) + "\n" + note
