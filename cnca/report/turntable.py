"""Pictures of a run's vehicle from all around, rendered once and kept in the run's folder."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from rich.console import Console

from cnca import build
from cnca.core.errors import RunError, SceneError
from cnca.core.manifest import hashes
from cnca.core.pictures import as_pictures
from cnca.core.progress import bar
from cnca.core.types import SrgbImages
from cnca.judge.candidates import Candidate, parse_candidates, read_candidate
from cnca.judge.evaluate import Shots, photograph
from cnca.judge.gallery import digest, kept_pictures
from cnca.judge.stage import scene_key
from cnca.report.blocks import Turntable
from cnca.report.comparison import TITLES
from cnca.report.webpage import jpeg_uri
from cnca.scene.cameras import View, circle
from cnca.scene.load_scene import load_scene
from cnca.scene.schema import Scene
from cnca.vehicle.model import Vehicle

SAMPLES = 16
"""Rays per pixel: enough for pictures that turn."""
WIDTH, HEIGHT = 384, 288
FIELD_OF_VIEW, ELEVATION = 45.0, 12.0
MOST_FRAMES = 360


@dataclass(frozen=True)
class Subject:
    """What turns: a scene's vehicle in a texture."""

    name: str
    scene: Path
    texture: Candidate


def turntables(folder: Path, frames: int, console: Console) -> list[Turntable]:
    """Every camouflage of the run in ``frames`` views around its vehicle, front first.

    Rendered where ``folder/turntable`` does not hold them.  Leaves out, and says so, what was
    painted for a scene that cannot be read any more.

    Raises:
        RunError: ``frames`` is not between 0 and 360.
    """
    if not 0 <= frames <= MOST_FRAMES:
        raise RunError(f"--turntable {frames}: give 0 for none, or up to {MOST_FRAMES} frames")
    turned = []
    for subject in _subjects(folder) if frames else ():
        try:
            scene = load_scene(subject.scene)
        except SceneError as error:
            console.print(f"no turntable of {subject.name}: {error}", soft_wrap=True)
            continue
        pictures = _turn(scene, subject, folder / "turntable", frames, console)
        turned.append(Turntable(subject.name, [jpeg_uri(each) for each in as_pictures(pictures)]))
    return turned


def _subjects(folder: Path) -> Iterator[Subject]:
    """The camouflages in the folder and, for a comparison, in its runs' folders."""
    manifest = folder / "manifest.json"
    if manifest.is_file():
        request = json.loads(manifest.read_text(encoding="utf-8"))["request"]
        if (folder / "texture.png").is_file():
            yield Subject("camouflage", Path(request["scene"]), Candidate("texture", folder))
        for texture in parse_candidates(request.get("textures", [])):
            yield Subject(texture.name, Path(request["scenes"][0]), texture)
    for name in TITLES:
        if (folder / f"{name}.json").is_file():
            content = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
            for row in content["rows"]:
                for subject in _subjects(folder / row["folder"]):
                    yield Subject(row["label"], subject.scene, subject.texture)


def _turn(scene: Scene, subject: Subject, kept: Path, frames: int, console: Console) -> SrgbImages:
    vehicle = build.build_vehicle(scene)
    texture = read_candidate(subject.texture, vehicle, scene.vehicle.texture_size)
    albedo = build.build_paint(scene, vehicle).apply(texture)
    views = around(vehicle, frames)
    files = hashes(build.files_behind(scene))
    drawn = scene_key(scene, vehicle, files=files, backend="mitsuba", samples=SAMPLES)
    key = digest(drawn, albedo, views)

    def take() -> SrgbImages:
        renderer = build.build_renderer(scene, vehicle, samples=SAMPLES)
        with bar(console) as shown:
            task = shown.add_task(f"turntable of {subject.name}", total=frames)
            taken: list[torch.Tensor] = []
            for view in views:
                shots = Shots([[view]], [scene.weather()], 0)
                taken.append(photograph(renderer, albedo, shots, 0))
                shown.advance(task)
        return SrgbImages(torch.cat(taken))

    name = re.sub(r"[^\w.+-]", "_", subject.name)
    return kept_pictures(kept / f"{name}.npz", key, take)


def around(vehicle: Vehicle, frames: int) -> list[View]:
    """Cameras on a circle, so far away that the vehicle just fits into each picture."""
    corners = np.concatenate([part.vertices for part in vehicle.parts])
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    radius = float(np.linalg.norm(corners - middle, axis=1).max())
    distance = radius / math.sin(math.radians(FIELD_OF_VIEW / 2))
    return circle(
        frames,
        ELEVATION,
        distance,
        fov=FIELD_OF_VIEW,
        width=WIDTH,
        height=HEIGHT,
        target=tuple(middle.tolist()),
    )
