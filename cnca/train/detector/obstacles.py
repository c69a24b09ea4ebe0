"""Things that are no vehicles, as a class of their own for detectors to learn.

A detector of vehicles alone knows only one name for what stands on a road, and reports loud boxes
and barrels as cars.  Detectors trained on COCO have 79 other names to give; with this class ours
have one, too.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

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
    nearer, found = [np.array(box[:4], float) for box in hidden_by], []
    for box in _by_distance(things, view):
        inside = box.clip(0, [view.width, view.height] * 2)
        free = _area(inside) - max((_area(_common(inside, other)) for other in nearer), default=0.0)
        large = (inside[2:] - inside[:2]).min() >= LEAST_SIDE
        if large and free >= LEAST_FREE * _area(box):
            found.append([*inside.tolist(), OBSTACLE])
        nearer.append(inside)
    return found


def _by_distance(things: Sequence[Part], view: View) -> list[Float[np.ndarray, "4"]]:
    """xyxy of the things that are wholly before the camera, the nearest first."""
    boxes = []
    for thing in things:
        pixels, depth = project(thing.vertices, view)
        if depth.min() > NEAREST:
            box = np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])
            boxes.append((float(depth.mean()), box))
    return [box for _, box in sorted(boxes, key=lambda pair: pair[0])]


def _common(first: Float[np.ndarray, "4"], second: Float[np.ndarray, "4"]) -> np.ndarray:
    low, high = np.maximum(first[:2], second[:2]), np.minimum(first[2:], second[2:])
    return np.concatenate([low, np.maximum(low, high)])


def _area(box: np.ndarray) -> float:
    return float((box[2:] - box[:2]).clip(min=0).prod())
