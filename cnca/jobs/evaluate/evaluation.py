"""One ``cnca evaluate`` from start to report.

The folder gets ``manifest.json``, ``results.json``, ``results.md``, the pictures named in it, and
below ``pictures``, ``detections`` and ``boxes`` what makes a rerun quick.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from cnca import build
from cnca.core import parallel
from cnca.core.manifest import hashes, write_json
from cnca.core.pictures import write_png
from cnca.core.progress import bar
from cnca.core.records import as_json
from cnca.core.run_folder import RunFolder
from cnca.detect import detector_files
from cnca.jobs.evaluate.parts import build_eyes, build_stages, shared_label
from cnca.jobs.evaluate.request import EvaluationRequest
from cnca.judge.candidates import Candidate, named, parse_candidates
from cnca.judge.records import Evidence
from cnca.judge.results import judge
from cnca.judge.stage import Eye, Stage, see
from cnca.judge.verdict import Seen
from cnca.report.evidence_pictures import contact_sheet, plot_azimuths, plot_sections
from cnca.report.tables import write_markdown
from cnca.scene.load_scene import load_scene

JOB = "evaluate"
"""Which command's results the folder holds."""


def evaluate_scenes(request: EvaluationRequest, console: Console) -> Evidence:
    """Render, look, judge, write everything; returns what ``results.json`` holds.

    Raises:
        CncaError: a scene, texture or detector cannot be used.
    """
    candidates = parse_candidates(request.textures)
    eyes = build_eyes(request.detectors, shared_label(request.scenes))
    for eye in eyes:
        if note := getattr(eye.detector, "note", ""):  # a user's own detector need not have one
            console.print(f"{eye.name}: {note}", soft_wrap=True, markup=False, highlight=False)
    stages = build_stages(request, candidates)
    parallel.by_first(lambda: _write_manifest(request, candidates))
    with bar(console) as shown:
        total = len(stages[0].rows) * sum(len(stage.shots.weathers) for stage in stages)
        task = shown.add_task("weathers", total=len(parallel.share(range(total))))
        seen = see(stages, eyes, lambda: shown.advance(task))

    def conclude() -> Evidence:
        results = judge(stages, eyes, seen, [c.name for c in candidates], request.seed)
        write_evidence(request.out, results, stages, eyes, seen)
        return results

    return parallel.by_first(conclude)


def write_evidence(
    out: Path,
    results: Evidence,
    stages: Sequence[Stage],
    eyes: Sequence[Eye],
    seen: dict[str, dict[str, Seen]],
) -> None:
    """Write results.json, results.md and the pictures into ``out``."""
    pictures = [plot_sections(out, results.sections)]
    pictures += plot_azimuths(out, results.sections)
    first = 0
    for stage in stages:
        for eye in eyes:
            name = f"views_{stage.name}_{eye.folder}.png"
            write_png(out / name, contact_sheet(stage, eye, seen, first))
            pictures.append(name)
        first += len(stage.places)
    write_json(out / "results.json", as_json(results))
    write_markdown(out / "results.md", results, pictures)


def _write_manifest(request: EvaluationRequest, candidates: Sequence[Candidate]) -> None:
    inputs = [candidate.picture for candidate in candidates]
    inputs += sorted(request.carla.glob("*.npz")) if request.carla else []
    for path in request.scenes:
        inputs += build.scene_files(load_scene(path), path)
    for spec in request.detectors:
        inputs += detector_files(named(spec)[1])
    if request.prompt is not None:
        inputs += build.generator_files(request.generator)
    RunFolder(request.out, JOB).renew(request, hashes(inputs))
