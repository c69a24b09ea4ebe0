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

from cnca.core.errors import RunError
from cnca.core.files import replacing
from cnca.core.types import Detections, SrgbImages

SrgbPicture = UInt8[np.ndarray, "_ _ 3"]
Color = tuple[int, int, int]
Plate = tuple[int, int, int, int]
"""Left, top, right and bottom of the ground of a label, in pixels."""

FOUND: Color = (255, 64, 32)
TRUTH: Color = (32, 220, 64)
LETTERS: Color = (0, 0, 0)
CAPTION: Color = (255, 255, 255)
FONT, FONT_SCALE = cv2.FONT_HERSHEY_SIMPLEX, 0.45
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
        boxes, taken = detections.boxes.tolist(), list[Plate]()
        for box in boxes:
            _rectangle(drawn, box, FOUND)
        for box, score, label in zip(boxes, detections.scores, detections.labels, strict=True):
            _label(drawn, f"{class_names[int(label)]} {float(score):.2f}", box, taken)
    return drawn


def side_by_side(
    pictures: Sequence[SrgbPicture],
    captions: Sequence[str] = (),
    *,
    columns: int | None = None,
    width: int | None = None,
) -> SrgbPicture:
    """A contact sheet: the pictures row by row, each under its caption, gaps in black.

    ``columns`` is by default the number of pictures, which makes one row.  A sheet of ``width``
    pixels per row shares them among its columns, and what is left over is a gap on the right.
    """
    columns = min(columns or len(pictures), len(pictures))
    if width is not None:
        pictures = [_scaled(picture, width // columns) for picture in pictures]
    texts = [*captions, *[""] * (len(pictures) - len(captions))]
    tiles = [_captioned(picture, text) for picture, text in zip(pictures, texts, strict=True)]
    height = max(tile.shape[0] for tile in tiles)
    wide = max(tile.shape[1] for tile in tiles)
    rows = -(-len(tiles) // columns)
    sheet = np.zeros((rows * height, width or columns * wide, 3), np.uint8)
    for index, tile in enumerate(tiles):
        top, left = index // columns * height, index % columns * wide
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


def _scaled(picture: SrgbPicture, width: int) -> SrgbPicture:
    height = max(round(picture.shape[0] * width / picture.shape[1]), 1)
    if width == picture.shape[1]:
        return picture
    how = cv2.INTER_AREA if width < picture.shape[1] else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(picture, (width, height), interpolation=how))


def _captioned(picture: SrgbPicture, text: str) -> SrgbPicture:
    if not text:
        return picture
    band = np.zeros((CAPTION_HEIGHT, picture.shape[1], 3), np.uint8)
    _write(band, text, (4, CAPTION_HEIGHT - 7), CAPTION)
    return np.concatenate([band, picture])


def _rectangle(picture: SrgbPicture, box: Sequence[float], color: Color) -> None:
    left, top, right, bottom = (round(value) for value in box)
    cv2.rectangle(picture, (left, top), (right, bottom), color, 2)


def _write(picture: SrgbPicture, text: str, at: tuple[int, int], color: Color) -> None:
    cv2.putText(picture, text, at, FONT, FONT_SCALE, color, 1, cv2.LINE_AA)


def _label(picture: SrgbPicture, text: str, box: Sequence[float], taken: list[Plate]) -> None:
    """Text on a plate above the box, or as near to that as the plates ``taken`` leave room."""
    (width, height), _ = cv2.getTextSize(text, FONT, FONT_SCALE, 1)
    width, height = width + 4, height + 6
    left = max(min(round(box[0]), picture.shape[1] - width), 0)
    lowest = max(round(box[1]), height)
    bottoms = [*range(lowest, height - 1, -1), *range(lowest, len(picture))]
    plates = [(left, bottom - height, left + width, bottom) for bottom in bottoms]
    plate = next((p for p in plates if not any(_overlap(p, other) for other in taken)), plates[0])
    taken.append(plate)
    cv2.rectangle(picture, plate[:2], plate[2:], FOUND, cv2.FILLED)
    _write(picture, text, (left + 2, plate[3] - 4), LETTERS)


def _overlap(one: Plate, other: Plate) -> bool:
    return all(one[i] <= other[i + 2] and other[i] <= one[i + 2] for i in (0, 1))
