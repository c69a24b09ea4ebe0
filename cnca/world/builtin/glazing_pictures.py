"""Pictures behind and on glass: rooms, shop windows, doors, names of shops, traffic signs."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float

from cnca.world.builtin.noise import fractal

Picture = Float[np.ndarray, "height width 3"]

ROOMS = (4, 8)
"""Rows and columns of the atlas of windows."""
SHOPS = (2, 4)
NAMES = ("BAKERY", "BOOKS", "CAFE LUNA", "FLOWERS", "PHARMACY", "OPTIK", "SHOES", "WINE & CO")
_NAME_COLORS = (
    ((0.25, 0.05, 0.04), (0.7, 0.65, 0.5)),
    ((0.03, 0.07, 0.05), (0.6, 0.5, 0.2)),
    ((0.55, 0.52, 0.45), (0.06, 0.03, 0.02)),
    ((0.08, 0.20, 0.08), (0.7, 0.7, 0.65)),
    ((0.60, 0.60, 0.58), (0.02, 0.20, 0.07)),
    ((0.03, 0.05, 0.16), (0.7, 0.7, 0.7)),
    ((0.02, 0.02, 0.02), (0.65, 0.6, 0.55)),
    ((0.16, 0.02, 0.05), (0.65, 0.55, 0.4)),
)


def rooms() -> Picture:
    """4 × 8 windows of 128 texels: curtains, blinds, plants and dark rooms."""
    rng = np.random.default_rng(31)
    rows, columns = ROOMS
    cells = [[_room(rng) for _ in range(columns)] for _ in range(rows)]
    return np.concatenate([np.concatenate(row, axis=1) for row in cells])


def _room(rng: np.random.Generator) -> Picture:
    size = 128
    y, x = np.mgrid[0:size, 0:size] / size
    depth = rng.uniform(0.012, 0.035)
    cell = depth * (1.5 - 0.9 * y)[..., None] * np.array([1.0, 0.95, 0.88])
    # The lit ceiling and the back wall of the room.
    cell = (
        cell
        + 0.5 * depth * (np.abs(x - rng.uniform(0.3, 0.7)) < 0.22)[..., None] * (y < 0.6)[..., None]
    )
    kind = rng.choice(["dark", "curtain", "sheer", "blind"], p=[0.30, 0.28, 0.24, 0.18])
    cloth = rng.uniform(0.18, 0.42) * np.array([1.0, rng.uniform(0.93, 1.0), rng.uniform(0.8, 1.0)])
    folds = 1 + 0.22 * np.sin(
        2 * np.pi * x * rng.uniform(9, 16)
        + 2 * fractal((size, size), rng, smallest=40, largest=128)
    )
    if kind == "curtain":
        half = rng.uniform(0.14, 0.30) * (1 + 0.25 * y)
        side = (x < half) | (x > 1 - half)
        cell = np.where(side[..., None], folds[..., None] * cloth, cell)
    elif kind == "sheer":
        low = rng.choice([1.0, 0.55])
        cell = np.where((y < low)[..., None], folds[..., None] * (0.55 * cloth + 0.04), cell)
    elif kind == "blind":
        low = rng.uniform(0.25, 0.9)
        slats = 0.85 + 0.15 * (y * 24 % 1 > 0.25)
        cell = np.where((y < low)[..., None], slats[..., None] * cloth, cell)
    if rng.random() < 0.35:
        plant = np.hypot((x - rng.uniform(0.25, 0.75)) * 1.2, y - 0.95) < rng.uniform(0.12, 0.22)
        leaf = 0.05 * (1 + 0.5 * fractal((size, size), rng, smallest=4, largest=20))
        cell = np.where(plant[..., None], leaf[..., None] * np.array([0.7, 1.2, 0.4]), cell)
    return np.clip(cell, 0.004, 0.6)


def lit_rooms() -> Picture:
    """What the same windows emit in the evening, 1 the brightest: somebody is at home in a third.

    A lamp lights the room from above, curtains and blinds from behind.
    """
    rng = np.random.default_rng(33)
    rows, columns = ROOMS
    light = np.zeros((rows, columns, 3))
    at_home = rng.choice(rows * columns, rows * columns // 3, replace=False)
    for row, column in zip(*divmod(at_home, columns), strict=True):
        warmth = rng.uniform(0.0, 0.5) * np.array([0.0, 0.3, 0.8])
        light[row, column] = rng.uniform(0.3, 1.0) * (1 - warmth)
    light = light.repeat(128, axis=0).repeat(128, axis=1)
    # Dark rooms reflect little of the lamp, cloth passes about as much as it reflects.
    return np.clip(light * (0.15 + 2.0 * rooms()), 0, 1)


def lit_shop_windows() -> Picture:
    """What the same displays emit: their own lamps light what is in them, but three are shut."""
    shut = np.array([[0, 1, 0, 0], [1, 0, 0, 1]])
    dim = np.where(shut, 0.05, 1.0).repeat(256, 0).repeat(256, 1)[..., None]
    return dim * shop_windows()


def shop_windows() -> Picture:
    """2 × 4 displays of 256 texels: shelves, goods and posters in dim rooms."""
    rng = np.random.default_rng(32)
    rows, columns = SHOPS
    cells = [[_display(rng) for _ in range(columns)] for _ in range(rows)]
    return np.concatenate([np.concatenate(row, axis=1) for row in cells])


def _display(rng: np.random.Generator) -> Picture:
    size = 256
    y = np.mgrid[0:size, 0:size][0] / size
    cell = 0.05 * (1.3 - 0.7 * y)[..., None] * np.array([1.0, 0.92, 0.8])
    for lamp in rng.uniform(0.1, 0.9, int(rng.integers(2, 6))):
        cv2.ellipse(cell, (int(lamp * size), 18), (9, 4), 0, 0, 360, (0.55, 0.5, 0.4), -1)
    for shelf in np.sort(rng.uniform(0.35, 0.9, int(rng.integers(2, 4)))):
        base, x = int(shelf * size), 8
        cv2.rectangle(cell, (4, base), (size - 5, base + 4), (0.14, 0.11, 0.08), -1)
        while x < size - 24:
            width, high = int(rng.integers(6, 24)), int(rng.integers(8, 38))
            color = (rng.uniform(0.03, 0.4) * rng.dirichlet([3, 3, 3]) * 2.2).tolist()
            if rng.random() < 0.75:
                cv2.rectangle(cell, (x, base - high), (x + width, base), color, -1)
            x += width + int(rng.integers(1, 12))
    if rng.random() < 0.6:
        left, top = int(rng.integers(20, 170)), int(rng.integers(40, 110))
        cv2.rectangle(cell, (left, top), (left + 55, top + 78), (0.5, 0.48, 0.44), -1)
        ink = (rng.uniform(0.02, 0.4, 3)).tolist()
        cv2.rectangle(cell, (left + 6, top + 6), (left + 49, top + 44), ink, -1)
    return np.clip(cv2.GaussianBlur(cell, (0, 0), 0.8), 0.006, 0.6)


def shop_names() -> Picture:
    """Eight boards of 512 × 64 texels, one above the other."""
    boards = []
    for name, (back, ink) in zip(NAMES, _NAME_COLORS, strict=True):
        board = np.full((64, 512, 3), _bytes(back), np.uint8)
        (wide, high), _ = cv2.getTextSize(name, cv2.FONT_HERSHEY_DUPLEX, 1.5, 3)
        at = ((512 - wide) // 2, (64 + high) // 2)
        cv2.putText(board, name, at, cv2.FONT_HERSHEY_DUPLEX, 1.5, _bytes(ink), 3, cv2.LINE_AA)
        boards.append(board)
    return np.concatenate(boards) / 255


def _bytes(color: tuple[float, float, float]) -> tuple[int, int, int]:
    """OpenCV writes letters into bytes alone; these are linear all the same."""
    red, green, blue = (round(255 * value) for value in color)
    return red, green, blue


SIGNS = ("speed", "no_parking", "parking", "yield", "crossing", "back")


def traffic_signs() -> Picture:
    """Faces of traffic signs side by side, 128 texels each, in the order of ``SIGNS``."""
    white, red, blue = (158, 158, 153), (107, 4, 5), (5, 18, 82)
    black = (5, 5, 5)
    faces = {name: np.full((128, 128, 3), 64, np.uint8) for name in SIGNS}
    middle, line = (64, 64), cv2.LINE_AA
    for name, border, inner in (("speed", red, white), ("no_parking", red, blue)):
        cv2.circle(faces[name], middle, 64, border, -1, line)
        cv2.circle(faces[name], middle, 50, inner, -1, line)
    cv2.putText(faces["speed"], "30", (26, 85), cv2.FONT_HERSHEY_DUPLEX, 2.0, black, 5, line)
    for end in ((100, 28), (28, 28)):
        cv2.line(faces["no_parking"], end, (128 - end[0], 128 - end[1]), red, 11, line)
    for name in ("parking", "crossing"):
        cv2.rectangle(faces[name], (0, 0), (127, 127), blue, -1)
    cv2.putText(faces["parking"], "P", (34, 100), cv2.FONT_HERSHEY_DUPLEX, 3.2, white, 9, line)
    cv2.fillPoly(faces["crossing"], [np.array([[64, 12], [116, 110], [12, 110]])], white, line)
    for x in (44, 60, 76):
        cv2.rectangle(faces["crossing"], (x, 78), (x + 7, 104), black, -1)
    cv2.circle(faces["crossing"], (66, 44), 8, black, -1, line)
    cv2.line(faces["crossing"], (65, 50), (58, 76), black, 9, line)
    cv2.rectangle(faces["yield"], (0, 0), (127, 127), red, -1)
    cv2.fillPoly(faces["yield"], [np.array([[26, 18], [102, 18], [64, 90]])], white, line)
    return np.concatenate([faces[name] for name in SIGNS], axis=1) / 255
