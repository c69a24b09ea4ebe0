"""Things that are no vehicles, as a class of their own for detectors to learn.

A detector of vehicles alone knows only one name for what stands on a road, and reports loud boxes
and barrels as cars.  Detectors trained on COCO have 79 other names to give; with this class ours
have one, too.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from cnca.core.boxes import area, clip, share_inside
from cnca.core.types import Boxes
from cnca.scene.cameras import View
from cnca.vehicle.model import Part
from cnca.vehicle.outline import project

CLASSES = ("car", "obstacle")
"""What is told apart in all pictures to train on."""
CAR, OBSTACLE = range(2)
LEAST_SIDE, LEAST_FREE = 9.0, 0.5
"""Pixels, and share of its box that is in the picture and behind nothing nearer."""
NEAREST = 0.3
"""Metres before the camera from which a thing can be projected."""


def obstacle_boxes(
    things: Sequence[Part], view: View, hidden_by: Sequence[Sequence[float]] = ()
) -> list[list[float]]:
    """left, top, right, bottom in pixels and class of each thing that is large and free enough.

    ``hidden_by`` are boxes of what stands before all of them, such as the vehicle's; a thing may
    also be hidden by a nearer one.
    """
    boxes = _by_distance(things, view)
    inside = clip(boxes, view.height, view.width)
    before = torch.cat([torch.tensor([box[:4] for box in hidden_by]).reshape(-1, 4), inside])
    found = []
    for k, box in enumerate(inside):
        hidden = share_inside(box[None], before[: len(hidden_by) + k])
        free = area(box) * (1 - hidden) / area(boxes[k])
        if (box[2:] - box[:2]).min() >= LEAST_SIDE and free >= LEAST_FREE:
            found.append([*box.tolist(), OBSTACLE])
    return found


def _by_distance(things: Sequence[Part], view: View) -> Boxes:
    """Boxes of the things that are wholly before the camera, the nearest first."""
    boxes = []
    for thing in things:
        pixels, depth = project(thing.vertices, view)
        if depth.min() > NEAREST:
            box = np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])
            boxes.append((float(depth.mean()), box))
    nearest = [box for _, box in sorted(boxes, key=lambda pair: pair[0])]
    return torch.tensor(np.array(nearest)).float().reshape(-1, 4)
