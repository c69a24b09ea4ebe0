"""Which convention a network follows, found by trying it on a picture that ships with CNCA.

Graphs do not say whether boxes are (x, y) or (y, x), in pixels or in fractions of the picture,
whether class 3 is COCO's fourth name or its number 3, or what white is.  The usual reading stays
where the network finds the car in the picture with it; otherwise the reading that finds the car
best is taken, and a note says so.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from itertools import product
from pathlib import Path

import cv2
import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from cnca.core.boxes import iou_matrix
from cnca.core.detections import ALARM, MATCH
from cnca.core.errors import DetectorError
from cnca.core.types import Candidates, SrgbImages
from cnca.detect.classes import vehicle_labels
from cnca.detect.onnx_decode import Unknown
from cnca.detect.onnx_layout import (
    BLUE_FIRST,
    BYTES,
    MMDETECTION,
    NANODET,
    YOLO,
    YOLOX,
    Layout,
    Outputs,
)
from cnca.detect.onnx_options import Options
from cnca.detect.preprocess import IMAGENET, PLAIN, Entry

PICTURE = Path(__file__).parents[1] / "assets" / "reference" / "car.jpg"
"""The built-in sedan in plain paint, rendered in a street of our own, 320 × 320."""
CAR = (50.0, 163.0, 269.0, 243.0)
"""Where the car is, xyxy in pixels."""
ENTRIES = (PLAIN, BYTES, IMAGENET, MMDETECTION, YOLO, YOLOX, BLUE_FIRST, NANODET)
READINGS = {
    "boxes": ("xyxy", "yxyx", "cxcywh"),
    "units": ("pixels", "picture"),
    "classes": ("coco", "coco91"),
}
"""Option → the values to try where the user says nothing."""
Find = Callable[[Outputs, Options], Layout]
Run = Callable[[Tensor], Outputs]


def settled(
    layout: Layout, options: Options, size: tuple[int, int], run: Run, find: Find
) -> tuple[Layout, str]:
    """The layout to take, and a note where it is not the usual one.

    Args:
        layout: the usual reading.
        options: what the user says, which is always taken as given.
        size: height and width of the input.
        run: one call of the network for pictures of the input's size.
        find: finds the layout from outputs and options; raises Unknown where none fits.
    """
    usual = options.entry(layout.entry)
    if _score(layout, *_seen(usual, size, run)) >= ALARM:
        return layout, ""
    best, chosen, said = ALARM, layout, ""
    for entry in dict.fromkeys([usual, *(options.entry(one) for one in ENTRIES)]):
        outputs, back = _seen(entry, size, run)
        for reading in _readings(options):
            try:
                tried = find(outputs, options.model_copy(update=reading))
            except Unknown:
                continue
            score = _score(tried, outputs, back)
            if score > best:
                best, chosen = score, Layout(entry, tried.class_names, tried.decode)
                said = _describe(reading, entry, usual)
    return chosen, said or "it does not find the car in the picture that ships"


def _readings(options: Options) -> Iterator[dict[str, str]]:
    """All combinations of the options that the user leaves open."""
    said = {key for key in READINGS if getattr(options, key) is not None}
    free = {key: values for key, values in READINGS.items() if key not in said}
    for values in product(*free.values()):
        yield dict(zip(free, values, strict=True))


def _seen(
    entry: Entry, size: tuple[int, int], run: Run
) -> tuple[Outputs, Callable[[Tensor], Tensor]]:
    """The network's outputs for the picture, and what maps boxes back into it."""
    inputs, placement = entry.prepare(reference_picture(), size)
    return run(inputs), placement.back


def _score(layout: Layout, outputs: Outputs, back: Callable[[Tensor], Tensor]) -> float:
    """The highest confidence of a box around the car, as any class of vehicle."""
    try:
        labels = sorted({n for own in vehicle_labels(layout.class_names).values() for n in own})
    except DetectorError:
        return 0.0
    found: Candidates = layout.decode(outputs)
    boxes = back(found.boxes[0])
    scores = (found.objectness[0, :, None] * found.class_scores[0])[:, labels].amax(dim=1)
    hit = iou_matrix(boxes, torch.tensor([CAR]))[:, 0] >= MATCH
    return float(scores[hit].max()) if bool(hit.any()) else 0.0


def _describe(reading: dict[str, str], entry: Entry, usual: Entry) -> str:
    parts = [f"{key} {value}" for key, value in reading.items()]
    if entry != usual:
        parts.append(f"{entry.channels} with white {entry.white:g}")
    return f"read as {', '.join(parts)}, for so it finds the car in the picture that ships"


@cache
def reference_picture() -> SrgbImages:
    """The picture, (1, 3, 320, 320) in [0, 1]."""
    pixels: Float[np.ndarray, "320 320 3"] = cv2.imread(str(PICTURE))[..., ::-1] / 255.0
    return SrgbImages(torch.from_numpy(pixels.copy()).permute(2, 0, 1)[None].float())
