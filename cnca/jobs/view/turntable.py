"""A short film: the vehicle turns in its scene, in plain paint and in a run's camouflage.

Both are seen side by side from the same places, with the same noise, and with a detector's boxes.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from rich.console import Console

from cnca import build
from cnca.attack.targets import parse_targets
from cnca.core.color import linear_to_srgb
from cnca.core.detections import ALARM
from cnca.core.errors import RunError
from cnca.core.files import replacing
from cnca.core.manifest import Manifest, hashes
from cnca.core.pictures import SrgbPicture, as_pictures, draw_boxes
from cnca.core.progress import bar
from cnca.core.types import LinearImages, LinearTexture, SrgbImages
from cnca.effects.plan import Demand
from cnca.jobs.view.turntable_request import TurntableRequest
from cnca.judge.candidates import Candidate, read_candidate
from cnca.judge.gallery import digest, kept_pictures
from cnca.judge.stage import scene_key
from cnca.mi_bridge.live import LiveCamera
from cnca.scene.cameras import View, circle
from cnca.scene.load_scene import load_scene
from cnca.scene.protocols import Detector
from cnca.scene.schema import CarlaCamera, Scene
from cnca.vehicle.model import Vehicle

PROPORTION = 0.65
"""Height over width of a picture."""
DISTANCE, ELEVATION = 7.5, 12.0
"""Of the camera where the scene's first one does not say."""
SECONDS = 4.0
"""Of one turn."""
QUALITY = 70
"""Of WebP: noise would take most of the file."""
GAP = 4
"""White pixels between both pictures."""


def turntable(request: TurntableRequest, console: Console) -> Path:
    """Write the animation of a run; its pictures are kept beside it and not rendered again.

    Raises:
        RunError: the folder holds no finished run.
    """
    asked = Manifest.read(request.run / "manifest.json").request
    if not (request.run / "texture.png").is_file() or "scene" not in asked:
        raise RunError(f"{request.run}: holds no texture.png of a finished cnca optimize")
    scene = load_scene(request.scene or Path(asked["scene"]))
    names = [*parse_targets(asked.get("detectors", []))]
    detector = build.build_detector(request.detector or names[0])
    vehicle = build.build_vehicle(scene)
    texture = read_candidate(Candidate("run", request.run), vehicle, scene.vehicle.texture_size)
    paint = build.build_paint(scene, vehicle)
    albedos = [paint.apply(), paint.apply(texture)]
    pictures = _photographed(request, scene, vehicle, albedos, console)
    rows = [_looked_at(detector, images) for images in pictures.split(request.frames)]
    write_animation(request.target, [_beside(pair) for pair in zip(*rows, strict=True)])
    return request.target


def views_around(scene: Scene, frames: int, width: int) -> list[View]:
    """Cameras on a circle, as high and as far away as the scene's first, which is where it begins.

    All in one place of the scene's world.
    """
    first, height = scene.cameras[0], max(round(width * PROPORTION), 1)
    start, elevation, distance, fov = 0.0, ELEVATION, DISTANCE, 45.0
    if not isinstance(first, CarlaCamera):
        start, elevation = first.azimuth, first.elevation
        distance, fov = first.distance, first.fov
    return circle(frames, elevation, distance, start=start, fov=fov, width=width, height=height)


def _photographed(
    request: TurntableRequest,
    scene: Scene,
    vehicle: Vehicle,
    albedos: Sequence[LinearTexture],
    console: Console,
) -> SrgbImages:
    """All views of the first texture, then of the next, (textures · views, 3, height, width)."""
    views = views_around(scene, request.frames, request.width)
    files = hashes(build.files_behind(scene))
    drawn = scene_key(scene, vehicle, files=files, backend="mitsuba", samples=request.samples)

    def take() -> SrgbImages:
        camera = LiveCamera(build.build_path_tracer(scene, vehicle))
        taken: list[torch.Tensor] = []
        with bar(console) as shown:
            task = shown.add_task("turntable", total=len(views) * len(albedos))
            for albedo in albedos:
                for view in views:
                    taken.append(_photograph(camera, albedo, view, scene, request.samples))
                    shown.advance(task)
        return SrgbImages(torch.cat(taken))

    key = digest(drawn, views, "turntable", *albedos)
    return kept_pictures(request.target.with_suffix(".npz"), key, take)


def _photograph(
    camera: LiveCamera, albedo: LinearTexture, view: View, scene: Scene, samples: int
) -> SrgbImages:
    """One view, as 8 bits have it; the same noise in all textures."""
    demand = Demand(forced={"gradient": "off", "samples": samples})
    chosen = camera.renderer.plan(albedo, [view], scene.weather(), demand=demand)
    total = np.zeros((view.height, view.width, 3), np.float32)
    for first in range(samples):
        total += camera.draw(chosen, albedo, view, seed=0, first=first)
    image = LinearImages(torch.from_numpy(total / samples).permute(2, 0, 1)[None])
    return SrgbImages((linear_to_srgb(image) * 255).round() / 255)


@torch.no_grad()
def _looked_at(detector: Detector, images: SrgbImages) -> list[SrgbPicture]:
    """The pictures with the boxes that count as found."""
    return [
        draw_boxes(picture, detector.detect(image[None])[0].above(ALARM), detector.class_names)
        for picture, image in zip(as_pictures(images), images, strict=True)
    ]


def _beside(pictures: Sequence[SrgbPicture]) -> SrgbPicture:
    gap = np.full((len(pictures[0]), GAP, 3), 255, np.uint8)
    first, *others = pictures
    return np.concatenate([first, *(part for other in others for part in (gap, other))], axis=1)


def write_animation(path: Path, frames: Sequence[SrgbPicture]) -> None:
    """Write ``.gif`` or ``.webp`` that turns for ever, whole or not at all."""
    first, *others = [Image.fromarray(frame) for frame in frames]
    pause = round(1000 * SECONDS / len(frames))
    with replacing(path) as temporary:  # GIF disregards the quality
        first.save(
            temporary, save_all=True, append_images=others, duration=pause, loop=0, quality=QUALITY
        )
