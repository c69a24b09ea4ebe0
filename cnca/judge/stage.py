"""Where an evaluation takes its pictures: a scene with its vehicle, its views and its textures."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import torch

from cnca.core import parallel
from cnca.core.detections import FAINTEST_SCORE
from cnca.core.manifest import DRAWING, program
from cnca.core.types import Boxes, Detections, SrgbImages
from cnca.detect.classes import CAR
from cnca.judge.candidates import Coat
from cnca.judge.evaluate import Shots, look, photograph
from cnca.judge.gallery import Arrays, digest, kept_detections, kept_pictures, recall
from cnca.judge.records import FrameFit
from cnca.judge.rows import IGNORE
from cnca.judge.truth import Other, Truth, others_in
from cnca.judge.verdict import Seen
from cnca.scene.cameras import View
from cnca.scene.protocols import Detector, Renderer
from cnca.scene.schema import Scene


@dataclass(frozen=True)
class Eye:
    """A detector of an evaluation."""

    name: str
    detector: Detector
    key: str
    """Stands for its files."""

    @property
    def folder(self) -> str:
        """The name of the folder of its detections."""
        return re.sub(r"[^\w.+-]", "_", self.name)


@dataclass(frozen=True)
class Stage:
    """One scene of an evaluation; pictures and detections are kept below ``folder``."""

    name: str
    renderer: Renderer
    shots: Shots
    coats: Mapping[str, Coat]
    folder: Path
    key: str
    """Stands for all that decides the pictures, save texture, views, weather and seed."""
    label: str = CAR
    """What the vehicle is; the same on all stages of an evaluation."""
    others: str = IGNORE
    """What becomes of other vehicles; one of :data:`cnca.judge.rows.OTHERS`."""
    photographs: Mapping[str, Callable[[int], SrgbImages]] = field(default_factory=dict)
    """Rows without a texture: name → the pictures of a weather, such as CARLA's own frames."""
    frames: Sequence[FrameFit] = ()
    """How well the vehicle meets the photographs, where it is drawn over some."""

    @property
    def rows(self) -> list[str]:
        """The names of all photographs and textures."""
        return [*self.photographs, *self.coats]

    @property
    def places(self) -> list[tuple[int, int]]:
        """Weather and place in it of each view, in order."""
        return [(w, i) for w, views in enumerate(self.shots.views) for i in range(len(views))]

    def boxes(self) -> Boxes:
        """The vehicle's box in every view."""
        parts = []
        for weather, views in enumerate(self.shots.views):

            def measured(views: Sequence[View] = views) -> Arrays:
                return {"boxes": self.renderer.vehicle_boxes(views).numpy()}

            path = self.folder / "boxes" / self.name / f"weather{weather:02d}.npz"
            parts.append(recall(path, digest(self.key, views), measured)["boxes"])
        return torch.cat([torch.from_numpy(part) for part in parts])

    def truth(self) -> Truth:
        """The vehicle in every view, and the others that the renderer knows of."""
        return Truth(self.boxes(), self.others_seen(), self.others)

    def others_seen(self) -> list[list[Other]]:
        """Of every view, what else with a label is in it."""
        return [seen for views in self.shots.views for seen in others_in(self.renderer, views)]

    def pictures(self, row: str, weather: int) -> SrgbImages:
        """The pictures of one row in one weather, taken where they are not kept."""
        return self._shoot(row, weather)[1]()

    def look(self, row: str, weather: int, eyes: Sequence[Eye]) -> dict[str, list[Detections]]:
        """What each detector reports; pictures are taken at most once, for the first who asks."""
        key, pictures = self._shoot(row, weather)
        detections = {}
        for eye in eyes:
            path = self.folder / "detections" / eye.folder / self._place(row, weather)

            def seen(eye: Eye = eye) -> list[Detections]:
                return look(eye.detector, pictures(), FAINTEST_SCORE)

            detections[eye.name] = kept_detections(path, digest(key, eye.key, FAINTEST_SCORE), seen)
        return detections

    def _shoot(self, row: str, weather: int) -> tuple[str, Callable[[], SrgbImages]]:
        """The key of some pictures, and what loads or takes them, once."""
        shots, path = self.shots, self.folder / "pictures" / self._place(row, weather)
        what = shots.views[weather], shots.weathers[weather], shots.seed + weather
        if row in self.photographs:
            key = digest(self.key, row, *what)
            return key, cache(lambda: self.photographs[row](weather))
        albedo = self.coats[row](weather)
        key = digest(self.key, albedo, *what)

        @cache
        def pictures() -> SrgbImages:
            def take() -> SrgbImages:
                return photograph(self.renderer, albedo, shots, weather)

            return kept_pictures(path, key, take)

        return key, pictures

    def _place(self, row: str, weather: int) -> str:
        return f"{self.name}/{row.replace(' ', '~')}/weather{weather:02d}.npz"


def whole_truth(stages: Sequence[Stage]) -> Truth:
    """The truth in the views of all stages, one after the other."""
    parts = [stage.truth() for stage in stages]
    others = [view for part in parts for view in part.others]
    return Truth(torch.cat([part.boxes for part in parts]), others, parts[0].choice)


def see(
    stages: Sequence[Stage], eyes: Sequence[Eye], advance: Callable[[], None] = lambda: None
) -> dict[str, dict[str, Seen]]:
    """Row → detector → what it saw over the views of all stages, which have the same rows.

    ``advance`` is called after each row and weather that this process looks at.
    """
    looks = [
        (row, stage, weather)
        for stage in stages
        for weather in range(len(stage.shots.weathers))
        for row in stages[0].rows  # innermost, since worlds are expensive to build
    ]
    looked = []
    for row, stage, weather in parallel.share(looks):
        looked.append(stage.look(row, weather, eyes))
        advance()
    every: dict[str, dict[str, list[Detections]]] = {}
    for (row, *_), by_eye in zip(looks, parallel.gathered(looked), strict=True):
        for name, detections in by_eye.items():
            every.setdefault(row, {}).setdefault(name, []).extend(detections)
    names, label = {eye.name: eye.detector.class_names for eye in eyes}, stages[0].label
    return {
        row: {name: Seen(by_eye[name], classes, label) for name, classes in names.items()}
        for row, by_eye in every.items()
    }


def scene_key(
    scene: Scene, *drawn: object, files: Mapping[str, str], backend: str, samples: int | None
) -> str:
    """Stands for the whole scene and for all that draws it, whatever of it a picture shows.

    Args:
        drawn: what was made of the scene, such as its vehicle, by content.
        files: what it was made from → SHA-256.
    """
    contents = sorted(files.values())  # wherever they lie
    return digest(scene, drawn, contents, backend, samples, program(*DRAWING))
