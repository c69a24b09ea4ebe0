"""A converged reference of one view: picture and texture gradient, in two independent halves."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import torch
from rich.console import Console
from torch import Tensor
from torch.nn import functional

from cnca import build
from cnca.core.color import linear_to_srgb
from cnca.core.detections import LEAST_SCORE
from cnca.core.files import replacing
from cnca.core.manifest import DRAWING, hashes, program
from cnca.core.progress import bar
from cnca.core.types import LinearImages, LinearTexture
from cnca.effects.plan import Demand, EffectPlan
from cnca.jobs.accuracy.fidelity import (
    DARK,
    Pixels,
    error_of_mean,
    root,
    squared_noise,
    vehicle_pixels,
)
from cnca.jobs.accuracy.figure import Still
from cnca.jobs.accuracy.records import Agreement, PassSeconds
from cnca.jobs.accuracy.targets import Scenery, meet
from cnca.judge.gallery import digest
from cnca.judge.scores import detection_score
from cnca.mi_bridge.volpath import exposed_volpath
from cnca.scene.cameras import View
from cnca.scene.protocols import Detector
from cnca.scene.schema import Scene

ROUND = 128
"""Rays per pixel by which each half of the reference grows."""
CONVERGED = 0.005
"""Standard error of the reference's pixels at which it is good enough."""
MOST_ROUNDS = 128
CHANCE = 3.0
"""Standard errors by which the means of halves that agree may differ: 0.3 % do more by chance."""
REFERENCE_SEED = 1 << 20
"""Far from the seeds of what is compared with it: they never share random numbers."""


class Bench:
    """Renders one view of a scene and measures what it gets."""

    def __init__(self, scene: Scene, view: View, detector: Detector) -> None:
        vehicle = build.build_vehicle(scene)
        self.renderer = build.build_path_tracer(scene, vehicle)
        self.view, self.weather = view, scene.weather()
        self.albedo = build.build_paint(scene, vehicle).apply()
        self.mask = self.renderer.vehicle_mask([view])[0] == 1
        self.boxes = self.renderer.vehicle_boxes([view])
        self.detector = detector
        self.label = build.vehicle_label(detector.class_names, scene.vehicle.label)

    def plan(self, demand: Demand) -> EffectPlan:
        """The plan that meets the demand in this scene."""
        return self.renderer.plan(self.albedo, [self.view], self.weather, demand=demand)

    def shoot(
        self, demand: Demand, seed: int, scale: float = 1.0
    ) -> tuple[LinearImages, Tensor, PassSeconds]:
        """Picture, gradient of the vehicle's mean radiance, processor seconds of both passes."""
        width, height = (max(round(scale * n), 1) for n in (self.view.width, self.view.height))
        view = replace(self.view, width=width, height=height)
        albedo = self.albedo.clone().requires_grad_()
        started = time.process_time()
        image = self.renderer.render(
            LinearTexture(albedo), [view], self.weather, seed=seed, demand=demand
        )
        rendered = time.process_time()
        if scale != 1:
            size = (self.view.height, self.view.width)
            image = LinearImages(
                functional.interpolate(image, size, mode="bilinear", antialias=False)
            )
        image[0, :, torch.from_numpy(self.mask)].mean().backward()
        seconds = PassSeconds(rendered - started, time.process_time() - rendered)
        assert albedo.grad is not None
        return LinearImages(image.detach()), albedo.grad, seconds

    def aim(self, target: float, seed: int) -> tuple[LinearImages, Tensor, PassSeconds, EffectPlan]:
        """Like :meth:`shoot` for a target error, and the plan that a pilot made.

        Seconds hold the pilot's; the gradient is that of the same models and as many rays.
        """
        scenery = Scenery(self.renderer, self.albedo, self.view, self.weather, {})
        image, plan, measured = meet(scenery, target=target, seed=seed)
        demand = Demand(forced={**plan.models, "gradient": "texture"})
        _, gradient, seconds = self.shoot(demand, seed)
        return image, gradient, PassSeconds(measured.seconds, seconds.backward), plan

    def still(self, image: LinearImages, caption: str, reference: LinearImages | None) -> Still:
        """The picture around the vehicle, and its relative errors."""
        left, top, right, bottom = (int(edge) for edge in self.boxes[0].tolist())
        margin = max(right - left, bottom - top) // 12
        rows = slice(max(top - margin, 0), bottom + margin)
        columns = slice(max(left - margin, 0), right + margin)
        picture = linear_to_srgb(image)[0, :, rows, columns].permute(1, 2, 0).numpy()
        error = None
        if reference is not None:
            square = (image - reference)[0] ** 2 / (reference[0] ** 2 + DARK)
            error = square.mean(dim=0).sqrt()[rows, columns].numpy()
        return Still(caption, picture, error)

    def volpath(self, demand: Demand, seed: int) -> LinearImages:
        """The same view by Mitsuba's own volumetric path tracer, which gives no gradient."""
        samples = self.plan(demand).samples
        return exposed_volpath(
            self.renderer,
            self.albedo,
            self.view,
            self.weather,
            samples=samples,
            seed=seed,
            demand=demand,
        )

    def pixels(self, image: LinearImages) -> Pixels:
        """Those that show nothing but the vehicle."""
        return vehicle_pixels(image, self.mask)

    def score(self, image: LinearImages) -> float:
        """How surely the detector finds the vehicle."""
        detections = self.detector.detect(linear_to_srgb(image), score_threshold=LEAST_SCORE)[0]
        return detection_score(detections, self.boxes[0], self.label)


@dataclass
class Reference:
    """Two independent halves: sums of pictures and texture gradients over ``rounds`` each."""

    rounds: int = 0
    seconds: float = 0.0
    """Of the processor."""
    pictures: list[Tensor] = field(default_factory=list)
    gradients: list[Tensor] = field(default_factory=list)

    def picture_halves(self) -> tuple[LinearImages, LinearImages]:
        """Mean picture of each half."""
        first, second = (LinearImages(total / self.rounds) for total in self.pictures)
        return first, second

    def gradient_halves(self) -> tuple[Tensor, Tensor]:
        """Mean gradient of each half."""
        return self.gradients[0] / self.rounds, self.gradients[1] / self.rounds


def converge(
    bench: Bench, path: Path, deadline: float, *, volpath: bool = False, console: Console
) -> Reference:
    """The reference in ``path``, made better until it is converged or time is up.

    With ``volpath`` its pictures are Mitsuba's; its gradients stay ours, for volpath has none.
    """
    reference = _read_reference(path)
    demand = Demand(reference=True, forced={"samples": ROUND})
    with bar(console) as progress:
        task = progress.add_task("reference", total=MOST_ROUNDS, completed=reference.rounds)
        while reference.rounds < MOST_ROUNDS:
            if reference.rounds > 1 and agreement(bench, reference).standard_error < CONVERGED:
                break
            if reference.rounds > 0 and time.process_time() > deadline:
                break
            started = time.process_time()
            for half in range(2):
                seed = REFERENCE_SEED + 2 * reference.rounds + half
                image, gradient, _ = bench.shoot(demand, seed)
                image = bench.volpath(demand, seed) if volpath else image
                _add(reference.pictures, half, image)
                _add(reference.gradients, half, gradient)
            reference.rounds += 1
            reference.seconds += time.process_time() - started
            with replacing(path) as temporary:
                torch.save(asdict(reference), temporary)
            progress.update(task, completed=reference.rounds)
    return reference


def agreement(bench: Bench, reference: Reference) -> Agreement:
    """How well the halves agree: the standard error of their mean, and of their mean radiance."""
    a, b = (bench.pixels(picture) for picture in reference.picture_halves())
    difference = float(a.mean() / b.mean() - 1)
    chance = float(2 * error_of_mean((a, b)) / b.mean())  # standard error of the difference
    noise = squared_noise((a, b), (a, b)) / 2  # of the mean of both
    first, second = (gradient.flatten() for gradient in reference.gradients)
    cosine = functional.cosine_similarity(first, second, dim=0)
    return Agreement(
        samples=2 * ROUND * reference.rounds,
        standard_error=root(noise),
        difference_of_means=difference,
        halves_agree=abs(difference) <= CHANCE * chance,
        converged=root(noise) < CONVERGED,
        gradient_cosine=float(cosine),
        seconds=round(reference.seconds, 1),
    )


def fingerprint(scene: Scene, view: View, *, volpath: bool = False) -> str:
    """Hash of all that the reference depends on."""
    # The view and the number of rays are told apart.
    settings = scene.model_dump(mode="json", exclude={"cameras", "variation"})
    settings["image"].pop("samples")
    files = sorted(hashes(build.files_behind(scene)).values())
    return digest(program(*DRAWING), settings, view, volpath, files)[:16]


def _add(sums: list[Tensor], half: int, value: Tensor) -> None:
    if half < len(sums):
        sums[half] = sums[half] + value
    else:
        sums.append(value)


def _read_reference(path: Path) -> Reference:
    return Reference(**torch.load(path, weights_only=True)) if path.exists() else Reference()
