"""What a layout of an ONNX detector is, and how pictures enter networks of each kind."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from torch import Tensor

from cnca.core.types import Candidates
from cnca.detect.onnx_decode import Rows
from cnca.detect.preprocess import Entry

Outputs = Mapping[str, Tensor]
Table = Callable[[Outputs], Rows]

STRIDES = ((8, 16, 32), (8, 16, 32, 64))
USUAL_BINS = (8, 16, 17)
"""Distances per side that published networks tell apart; others need ``layout: distribution``."""
SIDE_WIDTHS = range(4 * 2, 4 * 65, 4)
LARGEST_WIDTH = 300
ANCHORS_PER_CELL = (1, 3)
BLUE_FIRST_MEAN, BLUE_FIRST_STD = (103.53, 116.28, 123.675), (57.375, 57.12, 58.395)
MMDETECTION = Entry("rgb", 255.0, BLUE_FIRST_MEAN[::-1], BLUE_FIRST_STD[::-1], "corner")
NANODET = Entry("bgr", 255.0, BLUE_FIRST_MEAN, BLUE_FIRST_STD)
BLUE_FIRST = Entry("bgr")
BYTES = Entry(white=255.0)
YOLO = Entry(fit="letterbox", fill=114.0)
YOLOX = Entry("bgr", 255.0, fit="corner", fill=114.0)


@dataclass(frozen=True)
class Layout:
    """How pictures enter a network, how boxes leave it, and what its classes are called."""

    entry: Entry
    """What is usual for networks of this kind."""
    class_names: Sequence[str]
    decode: Callable[[Outputs], Candidates]
    """The outputs of one call → candidates in pixels of the network's input."""
