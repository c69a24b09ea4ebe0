"""How well a detector finds the vehicle in each of several textures, over the same views."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import torch

from cnca.attack.targets import Target
from cnca.core.color import linear_to_srgb
from cnca.core.detections import LEAST_SCORE
from cnca.core.types import Boxes, Detections, LinearTexture, SrgbImages
from cnca.detect.classes import VEHICLE
from cnca.judge.scores import average_precision, detection_score
from cnca.judge.truth import Truth, others_in
from cnca.scene.cameras import View
from cnca.scene.protocols import Detector, Renderer
from cnca.scene.weather import Weather


@dataclass(frozen=True)
class Shots:
    """Pictures to take: the views of one weather belong together."""

    views: Sequence[Sequence[View]]
    weathers: Sequence[Weather]
    seed: int


@dataclass(frozen=True)
class Result:
    """What a detector saw of one texture."""

    images: SrgbImages
    boxes: Boxes
    detections: list[Detections]
    scores: list[float]
    """Detection score of each view, in [0, 1] (see :func:`cnca.judge.scores.detection_score`)."""
    average_precision: float
    """AP@0.5 of the vehicle, as Pascal VOC's area (see :mod:`cnca.judge.scores`)."""

    @property
    def mean_score(self) -> float:
        """Mean detection score over all views."""
        return sum(self.scores) / len(self.scores)


@torch.no_grad()
def photograph(renderer: Renderer, albedo: LinearTexture, shots: Shots, weather: int) -> SrgbImages:
    """Take the shots of one weather; 8 bits as a camera's file has, so that files lose nothing.

    The same ``shots.seed`` gives all textures the same noise.
    """
    rendered = renderer.render(
        albedo, shots.views[weather], shots.weathers[weather], seed=shots.seed + weather
    )
    return SrgbImages((linear_to_srgb(rendered) * 255).round() / 255)


def look(detector: Detector, images: SrgbImages, least: float = LEAST_SCORE) -> list[Detections]:
    """All detections of at least this confidence in each image."""
    return [detector.detect(image[None], score_threshold=least)[0] for image in images]


def evaluate(
    renderer: Renderer,
    targets: Sequence[Target],
    albedos: Mapping[str, LinearTexture],
    shots: Shots,
    advance: Callable[[], None] = lambda: None,
) -> dict[str, dict[str, Result]]:
    """Let every target look at every texture in every shot: name of target → of texture → result.

    Reports of other vehicles of the world are neither hits nor false alarms.

    Args:
        albedos: name → linear texture.
        advance: called after each rendered weather, for a progress bar.
    """
    boxes = torch.cat([renderer.vehicle_boxes(views) for views in shots.views])
    images: dict[str, list[torch.Tensor]] = {name: [] for name in albedos}
    # All textures in one weather, and so in one place, before the next: building worlds is slow.
    for weather in range(len(shots.weathers)):
        for name, albedo in albedos.items():
            images[name].append(photograph(renderer, albedo, shots, weather))
            advance()
    others = [seen for views in shots.views for seen in others_in(renderer, views)]
    truth = Truth(boxes, others)
    results: dict[str, dict[str, Result]] = {target.name: {} for target in targets}
    for name, drawn in images.items():
        for target in targets:
            results[target.name][name] = _judge(target, SrgbImages(torch.cat(drawn)), truth)
    return results


def _judge(target: Target, images: SrgbImages, truth: Truth) -> Result:
    detections, label, boxes = look(target.detector, images), target.label, truth.boxes
    scores = [detection_score(d, box, label) for d, box in zip(detections, boxes, strict=True)]
    truths = [box[None] for box in boxes]
    precision = average_precision(detections, truths, label, ignored=truth.ignored(VEHICLE))
    return Result(images, boxes, detections, scores, precision)
