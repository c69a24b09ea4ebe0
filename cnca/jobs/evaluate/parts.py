"""The scenes, textures and detectors that an evaluation asks for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

from cnca import build
from cnca.attack.parts import prompt_texture
from cnca.core.errors import DetectorError, RunError
from cnca.core.manifest import DETECTING, PAINTING, hashes, program
from cnca.core.types import SrgbImages, SrgbTexture
from cnca.detect import detector_files
from cnca.detect.classes import CAR, known_name
from cnca.effects.protocols import PlanningRenderer
from cnca.jobs.evaluate.frames import Frames, OverFrames, read_frames
from cnca.jobs.evaluate.request import EvaluationRequest
from cnca.judge.candidates import Candidate, make_coats, named, read_candidate
from cnca.judge.evaluate import Shots
from cnca.judge.gallery import digest, kept_pictures
from cnca.judge.held_out import held_out_shots
from cnca.judge.stage import Eye, Stage, scene_key
from cnca.scene.load_scene import load_scene
from cnca.scene.paper_grid import find_grid, grid_shots
from cnca.scene.schema import Scene
from cnca.vehicle.model import Vehicle


def shared_label(scenes: Sequence[Path]) -> str:
    """What the vehicle of all these scenes is; raises RunError where they differ in that."""
    labels = {path: known_name(load_scene(path).vehicle.label) for path in scenes}
    first = labels[scenes[0]]
    for path, label in labels.items():
        if label != first:
            raise RunError(
                f"--scene {path}: vehicle.label is {label}, and {first} in {scenes[0]}; evaluate "
                "one kind of vehicle at a time"
            )
    return first


def build_eyes(specs: Sequence[str], label: str = CAR) -> list[Eye]:
    """The detectors, each ``[NAME=]SPEC``, that are to find a ``label``.

    Raises DetectorError where two have one name, or one has no such class.
    """
    eyes: list[Eye] = []
    for spec in specs:
        name, what = named(spec)
        detector = build.build_detector(what)
        build.vehicle_label(detector.class_names, label, detector=f"--detector {what}")
        files = sorted(hashes(detector_files(what)).values())
        key = digest(detector.name, files, program(*DETECTING))
        eyes.append(Eye(name or detector.name, detector, key))
        if [eye.name for eye in eyes].count(eyes[-1].name) > 1:
            raise DetectorError(
                f"--detector {spec}: two detectors are called '{eyes[-1].name}'; write NAME={what}"
            )
    return eyes


def build_stages(request: EvaluationRequest, candidates: Sequence[Candidate]) -> list[Stage]:
    """The scenes with their textures, or the CARLA frames; all have the same rows."""
    # Painted when all else has been found in order: it takes the longest.
    prompts = cache(lambda: _prompts(request, candidates))
    names = _scene_names(request.scenes)
    return [
        _stage(request, path, name, candidates, prompts)
        for path, name in zip(request.scenes, names, strict=True)
    ]


def _stage(
    request: EvaluationRequest,
    path: Path,
    name: str,
    candidates: Sequence[Candidate],
    prompts: Callable[[], dict[str, SrgbTexture]],
) -> Stage:
    """One scene, or its vehicle in the folder's frames."""
    scene = load_scene(path)
    vehicle = build.build_vehicle(scene)
    frames = None if request.carla is None else _frames(request, request.carla, scene, vehicle)
    paint, size = build.build_paint(scene, vehicle), scene.vehicle.texture_size
    textures = {c.name: read_candidate(c, vehicle, size) for c in candidates}
    backend, samples = request.backend, request.samples
    renderer = build.build_renderer(scene, vehicle, backend=backend, samples=samples)
    stage = Stage(
        name=name,
        renderer=renderer,
        shots=_shots(request, scene),
        coats=make_coats(paint, textures, prompts(), wanted=request.controls, seed=request.seed),
        folder=request.out,
        label=known_name(scene.vehicle.label),
        others=request.others,
        key=scene_key(
            scene,
            vehicle,
            files=hashes(build.files_behind(scene)),
            backend=backend,
            samples=samples,
        ),
    )
    return stage if frames is None else _over_frames(stage, renderer, frames)


def _frames(request: EvaluationRequest, folder: Path, scene: Scene, vehicle: Vehicle) -> Frames:
    fits, weather = request.out / "fits", scene.weather()
    return read_frames(folder, vehicle, weather, fov=request.fov, kept=fits, seed=request.seed)


def _over_frames(stage: Stage, renderer: PlanningRenderer, frames: Frames) -> Stage:
    """The same vehicle in photographs, which are a row, too."""
    return replace(
        stage,
        name=frames.name,
        renderer=OverFrames(renderer, frames.photographs),
        shots=frames.shots,
        key=digest(stage.key, *frames.photographs.values()),
        photographs={"photograph": frames.photograph},
        frames=frames.fits,
    )


def _shots(request: EvaluationRequest, scene: Scene) -> Shots:
    """The grid's, or those that judge a ``cnca optimize`` of the same seed."""
    if request.grid is None:
        return held_out_shots(scene, request.views, request.seed)
    grid = find_grid(request.grid)
    return Shots(*grid_shots(scene, grid, request.views, seed=request.seed), request.seed)


def _prompts(request: EvaluationRequest, candidates: Sequence[Candidate]) -> dict[str, SrgbTexture]:
    """Row → texture with F_adv = 0: of ``--prompt``, and of every run's folder."""
    if "prompt" not in request.controls:
        return {}
    prompts = {
        f"{candidate.name} prompt": build.read_texture(candidate.prompt_picture)
        for candidate in candidates
        if candidate.prompt_picture
    }
    prompt = request.prompt
    if prompt is None:
        return prompts
    files = sorted(hashes(build.generator_files(request.generator)).values())
    key = digest(prompt, request.seed, files, program(*PAINTING))

    def paint_it() -> SrgbImages:
        texture = prompt_texture(build.build_generator(request.generator), prompt, request.seed)
        return SrgbImages(texture[None])

    kept = kept_pictures(request.out / "prompt.npz", key, paint_it)
    return {"prompt": SrgbTexture(kept[0]), **prompts}


def _scene_names(paths: Sequence[Path]) -> list[str]:
    names = [path.stem for path in paths]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice:
        raise RunError(f"--scene: two files are called '{twice}'; rename one")
    return names
