"""Random changes to training pictures (sRGB, uint8), by OpenCV."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from cnca.train.detector.cover import cover

Picture = UInt8[np.ndarray, "_ _ 3"]
BoxArray = Float[np.ndarray, "_ 4"]
Labels = Float[np.ndarray, "_ 5"]

ZOOM = (0.6, 1.8)
SHIFT = 0.2
"""Fraction of the picture by which it moves, at most."""
BRIGHTNESS, CONTRAST, TINT = 0.15, 0.35, 0.12
BLUR_CHANCE, NOISE_CHANCE, GREY_CHANCE, JPEG_CHANCE = 0.15, 0.2, 0.05, 0.3
JPEG_QUALITY = (30, 90)
SMALLEST_REMAINDER = 0.3
"""An object of which less than this fraction stays in the picture is no target any more."""
GREY = (128, 128, 128)


def augment(
    picture: Picture,
    labels: Labels,
    size: tuple[int, int],
    rng: np.random.Generator,
    *,
    loud_patches: bool = False,
) -> tuple[Picture, Labels]:
    """Return a picture of ``size`` (height, width), and what is to be found in it.

    ``labels`` are left, top, right, bottom in pixels, and the class; ``loud_patches`` are those of
    :func:`cnca.train.detector.cover.cover`.
    """
    picture, labels = _move(picture, labels, size, rng)
    if loud_patches:
        picture, labels = cover(picture, labels, rng)
    picture = _recolor(picture, rng)
    if rng.random() < BLUR_CHANCE:
        picture = cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.4, 1.5))
    if rng.random() < NOISE_CHANCE:
        noise = rng.normal(0, rng.uniform(2, 10), picture.shape).astype(np.float32)
        picture = np.clip(picture + noise, 0, 255).astype(np.uint8)
    if rng.random() < JPEG_CHANCE:
        quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(*JPEG_QUALITY))]
        picture = cv2.imdecode(cv2.imencode(".jpg", picture, quality)[1], cv2.IMREAD_COLOR)
    return picture, labels


def _move(
    picture: Picture, labels: Labels, size: tuple[int, int], rng: np.random.Generator
) -> tuple[Picture, Labels]:
    """Zoom, shift and mirror; objects that leave the picture are dropped."""
    zoom = float(np.exp(rng.uniform(*np.log(ZOOM))))
    shift = tuple(rng.uniform(-SHIFT, SHIFT, 2))
    matrix = _placement(picture.shape, size, zoom, shift, mirrored=rng.random() < 0.5)
    moved = _warp_boxes(labels[:, :4], matrix)
    inside = np.clip(moved, 0, [size[1], size[0], size[1], size[0]])
    kept = _areas(inside) >= SMALLEST_REMAINDER * np.maximum(_areas(moved), 1.0)
    return _warp(picture, matrix, size), np.hstack([inside, labels[:, 4:]])[kept]


def _placement(
    shape: tuple[int, ...],
    size: tuple[int, int],
    zoom: float,
    shift: Sequence[float],
    mirrored: bool,
) -> np.ndarray:
    """The affine matrix that letterboxes a picture into ``size``, changed about the middle."""
    height, width = size
    scale = min(height / shape[0], width / shape[1]) * zoom
    sign = -scale if mirrored else scale
    x = width / 2 + shift[0] * width - sign * shape[1] / 2
    y = height / 2 + shift[1] * height - scale * shape[0] / 2
    return np.array([[sign, 0, x], [0, scale, y]])


def _warp(picture: Picture, matrix: np.ndarray, size: tuple[int, int]) -> Picture:
    # OpenCV's coordinates are those of pixel centers; boxes are measured from pixel borders.
    centres = matrix.copy()
    centres[:, 2] += matrix[:, :2].sum(axis=1) * 0.5 - 0.5
    smaller = abs(matrix[0, 0]) < 1
    if smaller:  # warpAffine does not filter: blur away what the target cannot show
        sigma = 0.5 * np.sqrt(1 / matrix[0, 0] ** 2 - 1)
        picture = cv2.GaussianBlur(picture, (0, 0), max(sigma, 0.01))
    return cv2.warpAffine(picture, centres, (size[1], size[0]), borderValue=GREY)


def _warp_boxes(boxes: BoxArray, matrix: np.ndarray) -> BoxArray:
    corners = boxes.reshape(-1, 2, 2) * [matrix[0, 0], matrix[1, 1]] + matrix[:, 2]
    return np.concatenate([corners.min(axis=1), corners.max(axis=1)], axis=1)


def _recolor(picture: Picture, rng: np.random.Generator) -> Picture:
    """Brightness, contrast and tint as one table per channel; sometimes grey."""
    levels = np.linspace(0, 1, 256)[:, None]
    contrast = np.exp(rng.uniform(-CONTRAST, CONTRAST))
    tint = np.exp(rng.uniform(-TINT, TINT, 3))
    table = ((levels - 0.5) * contrast + 0.5 + rng.uniform(-BRIGHTNESS, BRIGHTNESS)) * tint
    table = (np.clip(table, 0, 1) * 255).round().astype(np.uint8)
    picture = cv2.LUT(picture, table[None])
    if rng.random() < GREY_CHANCE:
        picture = np.repeat(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)[..., None], 3, axis=2)
    return picture


def _areas(boxes: BoxArray) -> np.ndarray:
    return (boxes[:, 2:] - boxes[:, :2]).clip(min=0).prod(axis=1)
