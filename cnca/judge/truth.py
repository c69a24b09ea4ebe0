"""What is truly in the pictures of an evaluation: the vehicle, and others like it around it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch

from cnca.core.types import Boxes
from cnca.detect.classes import CAR, VEHICLE, counted, known_name
from cnca.judge.rows import COUNT, IGNORE
from cnca.scene.cameras import View
from cnca.scene.protocols import Renderer, SightingRenderer

LEAST_SEEN, LEAST_WIDTH = 0.25, 16
"""Share of another vehicle that must be seen, and pixels across, for it to count as an object to
find: those that are smaller or more hidden are ignored."""


@dataclass(frozen=True)
class Other:
    """Another object in a picture."""

    label: str
    box: tuple[float, float, float, float]
    """xyxy in pixels, of what is seen of it."""
    occluded: float
    """Share of it that something hides, in [0, 1]."""

    @property
    def to_find(self) -> bool:
        """Whether enough of it is seen, for one that counts."""
        wide = self.box[2] - self.box[0] >= LEAST_WIDTH
        return wide and 1 - self.occluded >= LEAST_SEEN


def others_in(renderer: Renderer, views: Sequence[View]) -> list[list[Other]]:
    """Of each view, what else with a label is in it; nothing where the renderer knows of none."""
    if not isinstance(renderer, SightingRenderer):
        return [[] for _ in views]
    return [
        [Other(seen.label, seen.box, seen.occluded) for seen in view]
        for view in renderer.sightings(views)
    ]


@dataclass(frozen=True)
class Truth:
    """The vehicle in each view, and what else is there."""

    boxes: Boxes
    """The vehicle's own, (views, 4), xyxy."""
    others: Sequence[Sequence[Other]] = ()
    """Of each view; empty where no picture shows any."""
    choice: str = IGNORE
    """One of :data:`cnca.judge.rows.OTHERS`."""

    def __len__(self) -> int:
        return len(self.boxes)

    def part(self, views: Sequence[int] | slice) -> Truth:
        """The truth in some of the views."""
        numbers = range(len(self))[views] if isinstance(views, slice) else views
        others = [self.others[i] for i in numbers] if self.others else ()
        return Truth(self.boxes[list(numbers)], others, self.choice)

    def objects(self, column: str, label: str = CAR) -> list[Boxes]:
        """What is to be found in each view, the vehicle first; ``column`` is one of ``counted``."""
        classes = counted(label)[column] if self.choice == COUNT else ()
        return [
            torch.cat([box[None], self._of(view, classes, counts=True).to(box)])
            for view, box in enumerate(self.boxes)
        ]

    def ignored(self, column: str, label: str = CAR) -> list[Boxes]:
        """The regions of each view in which detections are left out.

        All other vehicles, whatever their kind; with ``count`` those of the column's classes
        that are too small or too hidden to be found.
        """
        table = counted(label)
        if self.choice == COUNT:
            return [self._of(v, table[column], counts=False) for v in range(len(self))]
        return [self._of(v, table[VEHICLE], counts=None) for v in range(len(self))]

    def _of(self, view: int, classes: Sequence[str], *, counts: bool | None) -> Boxes:
        """Boxes of the others of these classes; only those that count, or do not, unless None."""
        boxes = [
            other.box
            for other in (self.others[view] if self.others else ())
            if known_name(other.label) in classes and counts in (None, other.to_find)
        ]
        return torch.tensor(boxes, dtype=torch.float32).reshape(-1, 4)
