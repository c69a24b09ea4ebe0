"""Procedural patterns: each function paints one style as a 256×256 sRGB picture in [0, 1].

All take the same arguments: a random generator, a palette and ``cell``, the pattern's typical
size in pixels.  Lattices, stripes and fractal noise follow the usual recipes of procedural
texturing (Ebert et al., Texturing and Modeling, 2003).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from cnca.gen.palettes import Palette

SIZE = 256
"""Side of a picture in pixels."""

Field: TypeAlias = Float[np.ndarray, "256 256"]
Picture: TypeAlias = Float[np.ndarray, "256 256 3"]
Pattern: TypeAlias = Callable[[np.random.Generator, Palette, float], Picture]

_Y, _X = np.mgrid[0:SIZE, 0:SIZE].astype(np.float32)


def graffiti(rng: np.random.Generator, colors: Palette, cell: float) -> Picture:
    """Sprayed strokes with outlines, drips and blots over a wall in two colors."""
    picture = _blend(_noise(rng, 2.5 * cell) > 0.5, colors[0], _pick(rng, colors))
    for _ in range(int(1200 / cell)):
        color, outline = _pick(rng, colors), _pick(rng, colors)
        stroke, width = _curve(rng, reach=1.4 * cell), int(cell * rng.uniform(0.2, 0.6))
        for ink, thickness in ((outline, int(1.5 * width)), (color, width)):
            cv2.polylines(picture, [stroke], False, ink.tolist(), thickness, cv2.LINE_AA)
        for x, y in stroke[rng.random(len(stroke)) < 0.05].tolist():
            below = (x, y + int(cell * rng.uniform(0.5, 1.2)))
            cv2.line(picture, (x, y), below, color.tolist(), max(2, width // 5), cv2.LINE_AA)
    for x, y in rng.integers(0, SIZE, (int(1000 / cell), 2)).tolist():
        radius = int(rng.uniform(0.04, 0.14) * cell) + 1
        cv2.circle(picture, (x, y), radius, _pick(rng, colors).tolist(), -1, cv2.LINE_AA)
    return picture


def camouflage(rng: np.random.Generator, colors: Palette, cell: float) -> Picture:
    """Flat patches cut out of layered noise."""
    picture = np.broadcast_to(colors[0], (SIZE, SIZE, 3)).copy()
    for color in np.concatenate([colors[1:], colors[:1]]):
        patch = _noise(rng, cell) + 0.35 * _noise(rng, cell / 2.5) > 0.79
        picture[patch] = color
    return _soften(picture)


def balls(rng: np.random.Generator, colors: Palette, cell: float) -> Picture:
    """Shaded balls, one before the other, lit from the upper left."""
    picture = np.broadcast_to(0.35 * colors[0], (SIZE, SIZE, 3)).copy()
    for x, y in rng.uniform(0, SIZE, (int(2.0 * (SIZE / cell) ** 2), 2)):
        radius = 0.5 * cell * rng.uniform(0.75, 1.25)
        box = _window(x, y, radius)
        dx, dy = (_X[box] - x) / radius, (_Y[box] - y) / radius
        height = np.sqrt(np.clip(1.0 - dx**2 - dy**2, 0.0, 1.0))
        light = np.clip(0.62 * height - 0.5 * dx - 0.5 * dy, 0.0, 1.0)
        shaded = _pick(rng, colors) * (0.4 + 0.7 * light[..., None]) + light[..., None] ** 8 * 0.7
        coverage = np.clip((1.0 - np.hypot(dx, dy)) * radius, 0.0, 1.0)[..., None]
        picture[box] += coverage * (np.clip(shaded, 0.0, 1.0) - picture[box])
    return picture


def dots(rng: np.random.Generator, colors: Palette, cell: float) -> Picture:
    """Round dots on a staggered grid."""
    u, v = _rotated(rng, cell)
    row = np.floor(v)
    column = np.floor(u + 0.5 * (row % 2))
    distance = np.hypot(u + 0.5 * (row % 2) - column - 0.5, v - row - 0.5)
    dot = colors[1:][_hash(rng, column, row, len(colors) - 1)]
    return _blend(_edge(0.32 - distance, cell), colors[0], dot)


def snake(rng: np.random.Generator, colors: Palette, cell: float) -> Picture:
    """Overlapping diamond scales whose colors follow larger blotches."""
    u, v = _rotated(rng, 0.75 * cell, max_angle=0.4)
    a, b = u + 0.6 * v, u - 0.6 * v
    i, j = np.floor(a), np.floor(b)
    ridge = np.minimum(np.minimum(a - i, i + 1 - a), np.minimum(b - j, j + 1 - b))
    blotch = np.sin(0.9 * (i + j)) + np.sin(0.9 * (i - j)) + _hash(rng, i, j, 100) / 100
    scale = _steps(blotch, colors)
    shade = np.clip(0.35 + 2.6 * ridge, 0.0, 1.0) * (0.8 + 0.35 * (a - i))
    return np.clip(scale * shade[..., None], 0.0, 1.0)


def zebra(rng: np.random.Generator, colors: Palette, cell: float) -> Picture:
    """Warped stripes that fork and taper, in the palette's first two colors."""
    u, _ = _rotated(rng, cell)
    warp = _noise(rng, 3.0 * cell) * 2.6 + _noise(rng, 1.2 * cell) * 0.5
    return _blend(_edge(np.sin(2 * np.pi * (u + warp)), 0.15 * cell), colors[0], colors[1])


def stripes(rng: np.random.Generator, colors: Palette, cell: float) -> Picture:
    """Straight bands at one angle."""
    u, _ = _rotated(rng, 0.7 * cell)
    return _soften(colors[np.floor(u).astype(int) % len(colors)])


def plaid(rng: np.random.Generator, colors: Palette, cell: float) -> Picture:
    """Two sets of translucent bands woven at right angles, as in a tartan."""
    u, v = _rotated(rng, 2.0 * cell, max_angle=0.1)
    sett = colors[rng.integers(len(colors), size=6)]
    return 0.5 * (_soften(sett[_sixths(u)]) + _soften(sett[_sixths(v)]))


def waves(rng: np.random.Generator, colors: Palette, cell: float) -> Picture:
    """Bands that swing like water."""
    u, v = _rotated(rng, cell, max_angle=0.3)
    height = v + 0.35 * np.sin(2 * np.pi * (0.5 * u + 0.3 * _noise(rng, 2.0 * cell)))
    return _soften(colors[np.floor(2.0 * height).astype(int) % len(colors)])


def leaves(rng: np.random.Generator, colors: Palette, cell: float) -> Picture:
    """Pointed leaves with a midrib, strewn at all angles."""
    picture = np.broadcast_to(0.4 * colors[0], (SIZE, SIZE, 3)).copy()
    along = np.linspace(0.0, 1.0, 12)
    half = np.sin(np.pi * along**0.8) * 0.26
    outline = np.concatenate([np.stack([along, half], 1), np.stack([along, -half], 1)[::-1]]) - 0.5
    outline[:, 1] += 0.5
    for x, y in rng.uniform(0, SIZE, (int(3.5 * (SIZE / cell) ** 2), 2)):
        angle = rng.uniform(0, 2 * np.pi)
        axis = np.array([np.cos(angle), np.sin(angle)]) * cell * rng.uniform(0.8, 1.3)
        leaf = outline @ np.stack([axis, [-axis[1], axis[0]]]) + (x, y)
        color = _pick(rng, colors) * rng.uniform(0.75, 1.0)
        cv2.fillPoly(picture, [leaf.astype(np.int32)], color.tolist(), cv2.LINE_AA)
        tips = [tuple(int(t) for t in (x, y) + s * axis) for s in (-0.5, 0.5)]
        cv2.line(picture, *tips, (0.6 * color).tolist(), 1, cv2.LINE_AA)
    return picture


def flames(rng: np.random.Generator, colors: Palette, cell: float) -> Picture:
    """Tongues of fire that rise from the lower edge."""
    tongues = _noise(rng, 0.6 * cell, stretch=4.0) + 0.4 * _noise(rng, 0.35 * cell, stretch=2.5)
    heat = 0.75 * tongues + 1.1 * (_Y / SIZE) - 0.75
    ground = 0.12 * colors[0]
    return _ramp(np.clip(heat, 0.0, 1.0), np.concatenate([ground[None], colors]))


def bricks(rng: np.random.Generator, colors: Palette, cell: float) -> Picture:
    """A running bond of bricks with pale joints."""
    u, v = _X / cell + rng.random(), 2.0 * _Y / cell + rng.random()
    row = np.floor(v)
    u = u + 0.5 * (row % 2)
    column = np.floor(u)
    joint = np.minimum(0.5 - np.abs(u - column - 0.5), 0.5 * (0.5 - np.abs(v - row - 0.5)))
    grain = 0.85 + 0.3 * _noise(rng, 6.0)[..., None]
    face = colors[_hash(rng, column, row, len(colors))] * grain
    return np.clip(_blend(_edge(joint - 0.04, cell), np.full(3, 0.78), face), 0.0, 1.0)


def marble(rng: np.random.Generator, colors: Palette, cell: float) -> Picture:
    """Veins: stripes bent by turbulence."""
    u, _ = _rotated(rng, 1.6 * cell)
    vein = np.abs(np.sin(np.pi * (u + 2.2 * _fractal(rng, 2.0 * cell)))) ** 0.6
    return _ramp(1.0 - vein, colors)


def clouds(rng: np.random.Generator, colors: Palette, cell: float) -> Picture:
    """Soft fractal billows between the palette's colors."""
    return _ramp(np.clip(1.8 * _fractal(rng, 2.2 * cell) - 0.4, 0.0, 1.0), colors)


def leopard(rng: np.random.Generator, colors: Palette, cell: float) -> Picture:
    """Rosettes: dark broken rings around a darker centre, on the first color."""
    near, _, spread = _voronoi(rng, 0.8 * cell)
    ring = near / (0.8 * cell) + 0.3 * _noise(rng, 0.35 * cell) - 0.15
    mark = (np.abs(ring - 0.33) < 0.1) & (_noise(rng, 0.5 * cell) > 0.38)
    body = _blend(ring < 0.28, colors[0], colors[0] * 0.75)
    return _soften(_blend(mark, body, colors[1 + spread % (len(colors) - 1)]))


def mosaic(rng: np.random.Generator, colors: Palette, cell: float) -> Picture:
    """Irregular flat tiles (Voronoi cells) with dark seams."""
    near, second, site = _voronoi(rng, cell)
    tile = colors[site % len(colors)]
    return _blend(_edge((second - near - 2.5) / cell, cell), np.full(3, 0.12), tile)


def _noise(rng: np.random.Generator, cell: float, stretch: float = 1.0) -> Field:
    """Smooth noise over [0, 1] with features of ``cell`` pixels, ``stretch`` times as tall."""
    columns, rows = (int(np.ceil(SIZE / side)) + 3 for side in (cell, cell * stretch))
    grid = rng.random((rows, columns), dtype=np.float32)
    shift = 1.0 + rng.random(2)
    to_grid = np.array([[1 / cell, 0, shift[0]], [0, 1 / (cell * stretch), shift[1]]])
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    field = cv2.warpAffine(grid, to_grid, (SIZE, SIZE), flags=flags, borderMode=cv2.BORDER_REFLECT)
    low, high = field.min(), field.max()
    return (field - low) / (high - low)


def _fractal(rng: np.random.Generator, cell: float) -> Field:
    """Four octaves of noise over about [0, 1]."""
    weights = 0.5 ** np.arange(1, 5)
    octaves = [w * _noise(rng, max(2.0, 2 * w * cell)) for w in weights]
    return np.sum(octaves, axis=0) / weights.sum()


def _rotated(
    rng: np.random.Generator, cell: float, max_angle: float = np.pi
) -> tuple[Field, Field]:
    """Pixel coordinates in units of ``cell``, turned by up to ``max_angle`` and shifted."""
    angle = rng.uniform(-max_angle, max_angle)
    c, s = np.float32(np.cos(angle) / cell), np.float32(np.sin(angle) / cell)
    shift = rng.random(2, dtype=np.float32)
    return c * _X + s * _Y + shift[0], c * _Y - s * _X + shift[1]


def _voronoi(
    rng: np.random.Generator, cell: float
) -> tuple[Field, Field, Int[np.ndarray, "256 256"]]:
    """Distance to the nearest and second nearest jittered site in pixels, and a number per site."""
    count = int(np.ceil(SIZE / cell)) + 2
    corners = np.moveaxis(np.mgrid[0:count, 0:count], 0, -1) - 1.0
    centres = (cell * (corners + rng.random((count, count, 2)))).astype(np.float32)
    number = rng.integers(1000, size=(count, count))
    column, row = (_X / cell).astype(int), (_Y / cell).astype(int)
    near, second = np.full((2, SIZE, SIZE), np.inf, np.float32)
    site = np.zeros((SIZE, SIZE), int)
    for i, j in np.ndindex(3, 3):  # a point's nearest site lies in its own cell or beside it
        at = (column + i) * count + row + j
        distance = cv2.magnitude(centres[..., 0].take(at) - _X, centres[..., 1].take(at) - _Y)
        site = np.where(distance < near, number.take(at), site)
        second = np.minimum(second, np.maximum(near, distance))
        near = np.minimum(near, distance)
    return near, second, site


def _hash(rng: np.random.Generator, i: Field, j: Field, count: int) -> Int[np.ndarray, "256 256"]:
    """A random number below ``count`` for each lattice cell (i, j)."""
    table = rng.integers(count, size=(64, 64))
    return table[i.astype(int) % 64, j.astype(int) % 64]


def _curve(rng: np.random.Generator, reach: float) -> Int[np.ndarray, "points 2"]:
    """A smooth random stroke: a quadratic B-spline through a random walk, in pixels."""
    walk = rng.uniform(0, SIZE, 2) + np.cumsum(rng.normal(0, reach, (4, 2)), axis=0)
    for _ in range(3):  # Chaikin's corner cutting (1974) tends to the B-spline
        pairs = 0.75 * walk[:-1] + 0.25 * walk[1:], 0.25 * walk[:-1] + 0.75 * walk[1:]
        walk = np.concatenate(pairs, axis=1).reshape(-1, 2)
    return walk.astype(np.int32)


def _window(x: float, y: float, radius: float) -> tuple[slice, slice]:
    """The part of the picture that a disc can touch."""
    low, high = np.floor([y - radius, x - radius]), np.ceil([y + radius, x + radius]) + 1
    (top, left), (bottom, right) = np.clip([low, high], 0, SIZE).astype(int)
    return slice(top, bottom), slice(left, right)


def _pick(rng: np.random.Generator, colors: Palette) -> Float[np.ndarray, "3"]:
    return colors[rng.integers(len(colors))]


def _sixths(u: Field) -> Int[np.ndarray, "256 256"]:
    return np.floor(6.0 * u).astype(int) % 6


def _edge(signed: Field, cell: float) -> Field:
    """Coverage of the region ``signed`` > 0 (in units of ``cell``), about one pixel wide."""
    return np.clip(signed * cell + 0.5, 0.0, 1.0)


def _blend(
    weight: Field | Bool[np.ndarray, "256 256"], below: np.ndarray, above: np.ndarray
) -> Picture:
    """``above`` where ``weight`` is 1, ``below`` where it is 0."""
    w = np.asarray(weight, np.float32)[..., None]
    return ((1.0 - w) * below + w * above).astype(np.float32)


def _soften(picture: Picture) -> Picture:
    """Blur by about half a pixel: edges as an antialiased picture has them."""
    return cv2.GaussianBlur(np.ascontiguousarray(picture, np.float32), (3, 3), 0.6)


def _steps(field: Field, colors: Palette) -> Picture:
    """Flat colors by equal shares of the field's range."""
    low, high = field.min(), field.max()
    return colors[((field - low) / (high - low) * 0.999 * len(colors)).astype(int)]


def _ramp(field: Field, colors: Palette) -> Picture:
    """Colors interpolated along ``field`` in [0, 1]."""
    position = np.clip(field, 0.0, 1.0) * (len(colors) - 1)
    below = np.minimum(position.astype(int), len(colors) - 2)
    return _blend(position - below, colors[below], colors[below + 1])
