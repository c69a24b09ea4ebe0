"""The picture that the controls ask for: built once, drawn sample by sample, boxes and costs."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from cnca import build
from cnca.core.color import linear_to_srgb
from cnca.core.pictures import SrgbPicture, as_pictures
from cnca.core.types import LinearImages, LinearTexture, SrgbImages
from cnca.effects.plan import Demand, EffectPlan
from cnca.jobs.view.controls import Controls, controlled
from cnca.jobs.view.costs import EffectCost, TargetCost, effect_costs, target_costs
from cnca.jobs.view.paints import Painter
from cnca.mi_bridge.live import LiveCamera
from cnca.scene.cameras import View
from cnca.scene.protocols import Detector
from cnca.scene.schema import Scene
from cnca.scene.views import build_views
from cnca.scene.weather import Weather

DRAFT_PIXELS = 320 * 320
"""Of a picture that moves, at most."""


@dataclass(frozen=True)
class Box:
    """What a detector found; edges as shares of the picture's width and height."""

    label: str
    score: float
    left: float
    top: float
    right: float
    bottom: float


@dataclass(frozen=True, eq=False)
class Frame:
    """A picture as far as it has come."""

    picture: SrgbPicture
    samples: int
    """Rays per pixel so far."""
    planned: int
    """Rays per pixel at which it is done."""
    milliseconds: float
    """That all its samples took, measured."""
    boxes: list[Box]
    plan: list[EffectCost]
    targets: list[TargetCost]

    @property
    def done(self) -> bool:
        """Whether nothing more is drawn."""
        return self.samples >= self.planned


@dataclass(eq=False)
class _Accumulated:
    """Samples of one view, in one weather, by one plan."""

    view: View
    chosen: EffectPlan
    total: Float[np.ndarray, "height width 3"]
    samples: int = 0
    seconds: float = 0.0
    boxes: list[Box] = field(default_factory=list)


class Stage:
    """Keeps what the next picture can use: vehicle, world, kernels, detector, generator."""

    def __init__(self, scene: Scene, *, width: int | None = None) -> None:
        """``width`` stands for the scene's own; the height keeps the picture's proportion."""
        if width is not None:
            height = max(round(width * scene.image.height / scene.image.width), 1)
            image = scene.image.model_copy(update={"width": width, "height": height})
            scene = scene.model_copy(update={"image": image})
        self.original, self.scene = scene, scene
        self.albedo: LinearTexture | None = None
        self._kept: dict[str, tuple[object, Any]] = {}
        self._painter = Painter()
        self._controls: Controls | None = None
        self._models: dict[object, EffectPlan] = {}
        self._plan: list[EffectCost] = []
        self._targets: list[TargetCost] = []
        self._now: _Accumulated | None = None
        self.complaint = ""
        """Why the last controls could not be shown."""

    @property
    def ready(self) -> bool:
        """Whether there is something to draw."""
        return self._now is not None

    @property
    def is_painted(self) -> bool:
        """Whether the vehicle wears another paint than the scene's own."""
        return self._controls is not None and bool(self._controls.texture or self._controls.prompt)

    def slow(self, controls: Controls) -> str:
        """What takes seconds of these controls, in words; empty where nothing does."""
        before = self._controls
        if before is None:
            return "building the scene …"
        if controls.prompt and controls.prompt != before.prompt:
            return f"painting “{controls.prompt}” …"
        built = ("world_seed", "place", "wetness")
        if any(getattr(controls, key) != getattr(before, key) for key in built):
            return "building the world …"
        return ""

    def show(self, controls: Controls) -> None:
        """Turn to other controls; what they do not change is kept.

        Raises:
            CncaError: a texture, detector, place … that cannot be used; what was shown stays.
        """
        self.complaint = ""
        if controls == self._controls:
            return
        scene = controlled(self.original, controls)
        vehicle = self._keep("vehicle", scene.vehicle, lambda: build.build_vehicle(scene))
        paint = self._keep("paint", scene.vehicle, lambda: build.build_paint(scene, vehicle))
        around = (scene.vehicle, scene.ground, scene.world, scene.image.exposure)
        camera = self._keep("camera", around, lambda: _live_camera(scene, vehicle))
        size, coat = scene.vehicle.texture_size, (controls.texture, controls.prompt)
        texture = self._keep(
            "texture",
            coat,
            lambda: self._painter.texture(vehicle, size, file=coat[0], prompt=coat[1]),
        )
        albedo = self._keep("albedo", coat, lambda: paint.apply(texture))
        self._keep("detector", controls.detector, lambda: _detector(controls.detector))
        weather = self._keep("weather", _sky(scene), scene.weather)
        view = _view(scene, draft=controls.moving)
        chosen = self._choose(camera, albedo, view, weather, controls)
        self.scene, self.albedo, self._controls = scene, albedo, controls
        shape = view.height, view.width, 3
        self._now = _Accumulated(view, chosen, np.zeros(shape, np.float32))

    def step(self) -> Frame:
        """Draw one more sample of each pixel, unless the picture is done.

        Raises:
            NonFiniteError: the picture is not finite.
        """
        now = self._now
        assert now is not None, "show() comes first"
        assert self.albedo is not None
        if now.samples < now.chosen.samples:
            started = time.perf_counter()
            camera: LiveCamera = self._kept["camera"][1]
            drawn = camera.draw(now.chosen, self.albedo, now.view, seed=0, first=now.samples)
            now.total += drawn
            now.samples += 1
            now.seconds += time.perf_counter() - started
        images = self._images(now)
        if now.samples & (now.samples - 1) == 0:  # at 1, 2, 4, 8 …
            now.boxes = self._detect(images)
        return Frame(
            as_pictures(images)[0],
            now.samples,
            now.chosen.samples,
            round(1000 * now.seconds, 1),
            now.boxes,
            self._plan,
            self._targets,
        )

    def _keep(self, name: str, key: object, make: Any) -> Any:
        """What was made last under that name if its key is the same."""
        if name not in self._kept or self._kept[name][0] != key:
            self._kept[name] = (key, make())
        return self._kept[name][1]

    def _choose(
        self,
        camera: LiveCamera,
        albedo: LinearTexture,
        view: View,
        weather: Weather,
        controls: Controls,
    ) -> EffectPlan:
        """The plan; while the mouse drags it stays as it was when it took hold."""
        usual = Demand(forced={"gradient": "off"})

        def planned(target: float | None) -> EffectPlan:
            demand = replace(usual, target_error=target)
            return camera.renderer.plan(albedo, [view], weather, demand=demand)

        key = (id(camera), weather, controls.target_error)
        if not (controls.moving and key in self._models):
            whole = self.original.image.width * self.original.image.height
            self._models = {key: planned(controls.target_error)}
            if not controls.moving or not self._plan:
                self._plan = effect_costs(self._models[key], whole)
                self._targets = target_costs(planned, whole)
        return self._models[key]

    def _images(self, now: _Accumulated) -> SrgbImages:
        mean = torch.from_numpy(now.total / max(now.samples, 1)).permute(2, 0, 1)[None]
        return linear_to_srgb(LinearImages(mean))

    @torch.no_grad()
    def _detect(self, images: SrgbImages) -> list[Box]:
        detector: Detector | None = self._kept["detector"][1]
        if detector is None:
            return []
        found = detector.detect(images)[0]
        height, width = images.shape[2:]
        boxes = (found.boxes / torch.tensor([width, height, width, height])).tolist()
        return [
            Box(detector.class_names[int(label)], round(float(score), 4), *box)
            for box, score, label in zip(boxes, found.scores, found.labels, strict=True)
        ]


def _live_camera(scene: Scene, vehicle: Any) -> LiveCamera:
    return LiveCamera(build.build_path_tracer(scene, vehicle))


def _detector(name: str) -> Detector | None:
    return build.build_detector(name) if name else None


def _sky(scene: Scene) -> object:
    """All that makes a weather."""
    return scene.sun, scene.sky, scene.fog, scene.world.lamps if scene.world else None


def _view(scene: Scene, *, draft: bool) -> View:
    """The live camera's view; a draft is small enough to keep up with the mouse."""
    view = build_views(scene)[0]
    pixels = view.width * view.height
    if not draft or pixels <= DRAFT_PIXELS:
        return view
    shrink = (DRAFT_PIXELS / pixels) ** 0.5
    return replace(view, width=int(view.width * shrink), height=int(view.height * shrink))
