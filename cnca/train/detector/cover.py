"""Patches of loud texture on training pictures, some of them over vehicles.

After CutMix (Yun et al. 2019) and random erasing (Zhong et al. 2020).  A vehicle that is mostly
covered is no target any more, though its wheels and its outline still show; the patch is an
obstacle.  So a detector learns, as on roads, that loud textures are seldom vehicles.  Without these
patches it looks for wheels, windows and shadows alone, and no paint moves it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from cnca.gen.textures import sample
from cnca.train.detector.obstacles import LEAST_SIDE, OBSTACLE

CHANCE, MOST_PATCHES = 0.5, 3
"""Chance that a picture is covered at all, and by how many patches at most."""
AIMED = 0.5
"""Share of the patches that lie on a vehicle."""
ON_VEHICLE, ELSEWHERE = (0.5, 1.1), (0.1, 0.4)
"""Sides relative to those of the vehicle's box, or of the picture."""
LEAST_SEEN = 0.5
"""Share of its box that must stay free for a thing to remain a target."""
TEXTURES = 128

Picture = UInt8[np.ndarray, "_ _ 3"]


@cache
def loud_textures() -> tuple[Picture, ...]:
    """Procedural textures, sRGB, always the same."""
    rng = np.random.default_rng(TEXTURES)
    return tuple((sample(rng).picture * 255).round().astype(np.uint8) for _ in range(TEXTURES))


def cover(
    picture: Picture, labels: Float[np.ndarray, "_ 5"], rng: np.random.Generator
) -> tuple[Picture, Float[np.ndarray, "_ 5"]]:
    """Return the picture with patches, and what is still, or now, to be found in it.

    ``labels`` are left, top, right, bottom in pixels, and the class.
    """
    if rng.random() >= CHANCE:
        return picture, labels
    size, textures = picture.shape[:2], loud_textures()
    hidden, obstacles = np.zeros(size, bool), np.zeros((0, 5))
    vehicles = labels[labels[:, 4] != OBSTACLE, :4]
    for _ in range(rng.integers(1, MOST_PATCHES + 1)):
        patch = _patch(size, vehicles, rng)
        texture = _filled(textures[rng.integers(len(textures))], size, rng)
        picture = np.where(patch[..., None], texture, picture)
        obstacles = np.concatenate([_still_seen(patch, obstacles), _obstacle(patch)])
        hidden |= patch
    return picture, np.concatenate([_still_seen(hidden, labels), obstacles])


def _obstacle(patch: Bool[np.ndarray, "_ _"]) -> Float[np.ndarray, "_ 5"]:
    """The label of a patch; none of one that is too small to be found."""
    left, top, width, height = cv2.boundingRect(patch.astype(np.uint8))
    if min(width, height) < LEAST_SIDE:
        return np.zeros((0, 5))
    return np.array([[left, top, left + width, top + height, OBSTACLE]], float)


def _still_seen(
    hidden: Bool[np.ndarray, "_ _"], labels: Float[np.ndarray, "_ 5"]
) -> Float[np.ndarray, "_ 5"]:
    """Those of which enough is free."""
    return labels[np.array([_seen(hidden, row[:4]) >= LEAST_SEEN for row in labels], bool)]


def _seen(hidden: Bool[np.ndarray, "_ _"], box: Float[np.ndarray, "4"]) -> float:
    left, top = np.floor(box[:2]).astype(int)
    right, bottom = np.ceil(box[2:]).astype(int)
    return 1.0 - float(hidden[top:bottom, left:right].mean())


def _patch(
    size: Sequence[int], boxes: Float[np.ndarray, "_ 4"], rng: np.random.Generator
) -> Bool[np.ndarray, "_ _"]:
    """Where an ellipse or a turned rectangle lies, on a vehicle or anywhere."""
    height, width = size
    if len(boxes) and rng.random() < AIMED:
        left, top, right, bottom = boxes[rng.integers(len(boxes))]
        sides = rng.uniform(*ON_VEHICLE, 2) * (right - left, bottom - top)
        centre = np.array([left + right, top + bottom]) / 2 + rng.uniform(-0.2, 0.2, 2) * sides
        angle = rng.uniform(-15, 15)
    else:
        sides = rng.uniform(*ELSEWHERE, 2) * (width, height)
        centre, angle = rng.uniform(0, 1, 2) * (width, height), rng.uniform(0, 180)
    where = np.zeros((height, width), np.uint8)
    shape = (tuple(map(float, centre)), tuple(map(float, sides)), float(angle))
    if rng.random() < 0.5:
        cv2.ellipse(where, shape, 1, -1)
    else:
        cv2.fillConvexPoly(where, cv2.boxPoints(shape).astype(np.int32), 1)
    return where.astype(bool)


def _filled(texture: Picture, size: Sequence[int], rng: np.random.Generator) -> Picture:
    """The texture over a whole picture, turned, scaled, and darker or brighter."""
    height, width = size
    scale, angle = float(np.exp(rng.uniform(np.log(0.2), np.log(1.2)))), rng.uniform(0, 360)
    matrix = cv2.getRotationMatrix2D((width / 2, height / 2), angle, scale)
    matrix[:, 2] += rng.uniform(-0.5, 0.5, 2) * max(size)
    filled = cv2.warpAffine(
        texture, matrix, (width, height), flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REFLECT
    )
    return (filled * rng.uniform(0.3, 1.0)).astype(np.uint8)
