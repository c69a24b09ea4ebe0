"""YOLOv3 and YOLOv3-tiny as Darknet configurations, written from the paper.

YOLOv3: Redmon & Farhadi 2018, table 1 (Darknet-53) and section 2.3 (three scales, nine anchors).
YOLOv3-tiny: the authors' own small network, which the paper leaves out.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from cnca.core.errors import DetectorError, did_you_mean
from cnca.core.hub import fetched_file

COCO_CLASSES, ANCHORS_PER_HEAD = 80, 3
ANCHORS = "10,13, 16,30, 33,23, 30,61, 62,45, 59,119, 116,90, 156,198, 373,326"
TINY_ANCHORS = "10,14, 23,27, 37,58, 81,82, 135,169, 344,319"
STAGES = ((64, 1), (128, 2), (256, 8), (512, 8), (1024, 4))
"""Filters and residual blocks of Darknet-53, stage by stage; each halves the resolution first."""
END_OF_STRIDE_8, END_OF_STRIDE_16 = 36, 61
"""Layers that the two finer scales come back to."""


def yolov3(classes: int = COCO_CLASSES, size: int = 416) -> str:
    """The text of ``yolov3.cfg`` for pictures of ``size`` × ``size`` pixels (a multiple of 32)."""
    layers = [_net(size), _convolution(32, 3)]
    for filters, blocks in STAGES:
        layers.append(_convolution(filters, 3, stride=2))
        layers += [*_bottleneck(filters), "[shortcut]\nfrom=-3\nactivation=linear"] * blocks
    layers += _scale(1024, "6,7,8", ANCHORS, classes)
    layers += _finer(256, END_OF_STRIDE_16) + _scale(512, "3,4,5", ANCHORS, classes)
    layers += _finer(128, END_OF_STRIDE_8) + _scale(256, "0,1,2", ANCHORS, classes)
    return _joined(layers)


def yolov3_tiny(classes: int = COCO_CLASSES, size: int = 416) -> str:
    """The text of ``yolov3-tiny.cfg`` for pictures of ``size`` × ``size`` pixels."""
    layers = [_net(size)]
    for filters in (16, 32, 64, 128, 256):
        layers += [_convolution(filters, 3), "[maxpool]\nsize=2\nstride=2"]
    layers += [_convolution(512, 3), "[maxpool]\nsize=2\nstride=1"]
    layers += [_convolution(1024, 3), _convolution(256, 1), _convolution(512, 3)]
    layers += _head("3,4,5", TINY_ANCHORS, classes)
    layers += [*_finer(128, 8), _convolution(256, 3), *_head("0,1,2", TINY_ANCHORS, classes)]
    return _joined(layers)


CONFIGS: dict[str, Callable[[], str]] = {"yolov3": yolov3, "yolov3-tiny": yolov3_tiny}
"""NAME → what writes the configuration of ``NAME.weights`` where none lies beside it."""

ADDRESS = "https://pjreddie.com/media/files/"
"""Where the authors publish their weights."""
LICENSE = "public domain (Darknet's)"
PUBLISHED = {
    "yolov3": "523e4e69e1d015393a1b0a441cef1d9c7659e3eb2d7e15f793f060a21b32f297",
    "yolov3-tiny": "dccea06f59b781ec1234ddf8d1e94b9519a97f4245748a7d4db75d5b7080a42c",
}
"""Network → SHA-256 of its weights."""


def published_weights(name: str) -> Path:
    """The authors' weights, fetched once.

    Raises DetectorError for another name, without a network, or for other content.
    """
    if name not in PUBLISHED:
        known = ", ".join(f"darknet:{one}" for one in PUBLISHED)
        raise DetectorError(
            f"detector 'darknet:{name}': there is {known}{did_you_mean(name, PUBLISHED)}"
        )
    return fetched_file(
        f"darknet:{name}",
        f"{ADDRESS}{name}.weights",
        PUBLISHED[name],
        DetectorError,
        license_name=LICENSE,
    )


def _net(size: int) -> str:
    """Redmon's Darknet keeps the aspect ratio of a picture and fills the rest with grey."""
    return f"[net]\nwidth={size}\nheight={size}\nchannels=3\nletter_box=1"


def _convolution(filters: int, size: int, stride: int = 1) -> str:
    shape = f"filters={filters}\nsize={size}\nstride={stride}\npad=1"
    return f"[convolutional]\nbatch_normalize=1\n{shape}\nactivation=leaky"


def _bottleneck(filters: int) -> list[str]:
    return [_convolution(filters // 2, 1), _convolution(filters, 3)]


def _scale(filters: int, mask: str, anchors: str, classes: int) -> list[str]:
    """Six convolutions and the head of one scale."""
    return [*_bottleneck(filters) * 3, *_head(mask, anchors, classes)]


def _head(mask: str, anchors: str, classes: int) -> list[str]:
    outputs = ANCHORS_PER_HEAD * (5 + classes)
    count = anchors.count(",") // 2 + 1
    return [
        f"[convolutional]\nfilters={outputs}\nsize=1\nstride=1\npad=1\nactivation=linear",
        f"[yolo]\nmask={mask}\nanchors={anchors}\nclasses={classes}\nnum={count}",
    ]


def _finer(filters: int, layer: int) -> list[str]:
    """Go back before the head, upsample, and join with ``layer`` of the backbone."""
    return [
        "[route]\nlayers=-4",
        _convolution(filters, 1),
        "[upsample]\nstride=2",
        f"[route]\nlayers=-1,{layer}",
    ]


def _joined(layers: list[str]) -> str:
    return "\n\n".join(layers) + "\n"
