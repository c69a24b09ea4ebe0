"""Pictures for people: boxes drawn on images, images side by side, files written whole.

All pictures here are sRGB, uint8, (height, width, 3), channels in the order red, green, blue.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8
from torch import Tensor

from cnca.errors import RunError
from cnca.files import replacing
from cnca.types import Detections, SrgbImages

SrgbPicture = UInt8[np.ndarray, "height width 3"]
Colour = tuple[int, int, int]

FOUND: Colour = (255, 64, 32)
TRUTH: Colour = (32, 220, 64)
CAPTION: Colour = (255, 255, 255)
CAPTION_HEIGHT = 22
"""Pixels above a tile that hold its caption."""


def as_pictures(images: SrgbImages) -> list[SrgbPicture]:
    """Display values in [0, 1], rounded to 8 bits (values outside are clipped)."""
    levels = (images.detach().clamp(0, 1) * 255).round().byte()
    return list(np.ascontiguousarray(levels.permute(0, 2, 3, 1).cpu().numpy()))


def draw_boxes(
    picture: SrgbPicture,
    detections: Detections | None,
    class_names: Sequence[str],
    truth: Tensor | None = None,
) -> SrgbPicture:
    """A copy of ``picture`` with detections in red (class and confidence) and truth in green.

    ``truth`` is one box (4) or several (objects, 4), xyxy in pixels.
    """
    drawn = picture.copy()
    if truth is not None:
        for box in truth.reshape(-1, 4).tolist():
            _rectangle(drawn, box, TRUTH)
    if detections is not None:
        found = zip(detections.boxes, detections.scores, detections.labels, strict=True)
        for box, score, label in found:
            _rectangle(drawn, box.tolist(), FOUND)
            text = f"{class_names[int(label)]} {float(score):.2f}"
            left, top = int(box[0]), int(box[1])
            _write(drawn, text, (max(left, 0) + 2, max(top - 4, 12)), FOUND)
    return drawn


def side_by_side(
    pictures: Sequence[SrgbPicture], captions: Sequence[str] = (), *, columns: int | None = None
) -> SrgbPicture:
    """A contact sheet: the pictures row by row, each under its caption, gaps in black.

    ``columns`` is by default the number of pictures, which makes one row.
    """
    texts = [*captions, *[""] * (len(pictures) - len(captions))]
    tiles = [_captioned(picture, text) for picture, text in zip(pictures, texts, strict=True)]
    columns = min(columns or len(tiles), len(tiles))
    height = max(tile.shape[0] for tile in tiles)
    width = max(tile.shape[1] for tile in tiles)
    rows = -(-len(tiles) // columns)
    sheet = np.zeros((rows * height, columns * width, 3), np.uint8)
    for index, tile in enumerate(tiles):
        top, left = index // columns * height, index % columns * width
        sheet[top : top + tile.shape[0], left : left + tile.shape[1]] = tile
    return sheet


def write_png(path: Path, picture: SrgbPicture) -> None:
    """Write a PNG under a temporary name, then rename: a reader never sees half a file.

    Raises:
        RunError: the folder cannot be written.
    """
    done, encoded = cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
    if not done:
        raise RunError(f"{path}: OpenCV cannot encode a picture of shape {picture.shape}")
    with replacing(path) as temporary:
        temporary.write_bytes(encoded.tobytes())


def _captioned(picture: SrgbPicture, text: str) -> SrgbPicture:
    if not text:
        return picture
    band = np.zeros((CAPTION_HEIGHT, picture.shape[1], 3), np.uint8)
    _write(band, text, (4, CAPTION_HEIGHT - 7), CAPTION)
    return np.concatenate([band, picture])


def _rectangle(picture: SrgbPicture, box: Sequence[float], colour: Colour) -> None:
    left, top, right, bottom = (round(value) for value in box)
    cv2.rectangle(picture, (left, top), (right, bottom), colour, 2)


def _write(picture: SrgbPicture, text: str, at: tuple[int, int], colour: Colour) -> None:
    for shade, width in (((0, 0, 0), 3), (colour, 1)):  # an outline, legible on any ground
        cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.45, shade, width, cv2.LINE_AA)
