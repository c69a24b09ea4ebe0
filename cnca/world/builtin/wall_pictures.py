"""Painted pictures of walls and roofs, as linear reflectance; every one repeats."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cnca.world.builtin.noise import fractal, mix, step

Picture = Float[np.ndarray, "height width 3"]


def brick() -> Picture:
    """Stretcher bond of 8 × 24 bricks with mortar; 2 m wide, 1.8 m high."""
    rng = np.random.default_rng(21)
    return _bond(rng, (512, 512), (24, 8), (0.24, 0.095, 0.065), (0.34, 0.32, 0.28), 0.16)


def ashlar() -> Picture:
    """Sawn stone blocks of 60 × 30 cm; 2.4 m square."""
    rng = np.random.default_rng(22)
    return _bond(rng, (512, 512), (8, 4), (0.36, 0.32, 0.25), (0.22, 0.20, 0.17), 0.06)


def _bond(
    rng: np.random.Generator,
    shape: tuple[int, int],
    count: tuple[int, int],
    stone: tuple[float, float, float],
    joint: tuple[float, float, float],
    spread: float,
) -> Picture:
    """Rows of stones, every second row shifted by half a stone."""
    height, width = shape
    rows, columns = count
    y, x = np.mgrid[0:height, 0:width] / [[[height]], [[width]]]
    row = (y * rows).astype(int)
    shifted = (x * columns + 0.5 * (row % 2)) % columns
    tone = (1 + spread * rng.standard_normal((rows, columns)))[row, shifted.astype(int)]
    hue = (0.5 * spread * rng.standard_normal((rows, columns)))[row, shifted.astype(int)]
    grain = fractal(shape, rng, smallest=2, largest=12, slope=0.4)
    stained = fractal(shape, rng, smallest=30, largest=400, slope=1.2)
    shade = tone * (1 + 0.07 * grain + 0.05 * stained)
    picture = (
        shade[..., None] * np.array(stone) * (1 + hue[..., None] * np.array([0.5, -0.3, -0.6]))
    )
    gap_x = np.minimum(shifted % 1, 1 - shifted % 1) * width / columns
    gap_y = np.minimum(y * rows % 1, 1 - y * rows % 1) * height / rows
    picture = mix(np.array(joint) + 0 * picture, picture, step(np.minimum(gap_x, gap_y), 1.3, 1.2))
    return np.clip(picture, 0.02, 0.7)


def plaster() -> Picture:
    """Rendered wall near white, to be tinted; faint clouds and streaks; 4 m square."""
    rng = np.random.default_rng(23)
    shape = (512, 512)
    clouds = fractal(shape, rng, smallest=20, largest=400, slope=1.3)
    streaks = fractal(shape, rng, smallest=6, largest=60, slope=0.8, stretch=(7.0, 1.0))
    grain = fractal(shape, rng, smallest=2, largest=5, slope=0.2)
    shade = 0.84 * (1 + 0.045 * clouds + 0.03 * streaks + 0.025 * grain)
    return np.clip(shade[..., None] * np.array([1.0, 0.995, 0.98]), 0.2, 1.0)


def concrete() -> Picture:
    """Cast panels of 3 × 1.5 m with joints, anchor holes and streaks; 3 m square."""
    rng = np.random.default_rng(24)
    shape = (512, 512)
    clouds = fractal(shape, rng, smallest=12, largest=400, slope=1.2)
    streaks = fractal(shape, rng, smallest=8, largest=80, slope=0.8, stretch=(8.0, 1.0))
    shade = 1 + 0.07 * clouds + 0.06 * streaks
    y, x = np.mgrid[0:512, 0:512]
    shade[(y % 256 < 2) | (x < 2)] *= 0.6
    for hole in ((128, 64), (128, 192), (384, 64), (384, 192)):
        shade[(x - hole[0]) ** 2 + (y % 256 - hole[1] % 256) ** 2 < 9] *= 0.45
    return np.clip(shade[..., None] * np.array([0.33, 0.32, 0.30]), 0.05, 0.7)


def roof_tiles() -> Picture:
    """Clay tiles, 8 × 6 in 2 m square."""
    rng = np.random.default_rng(25)
    size, columns, rows = 256, 10, 6
    y, x = np.mgrid[0:size, 0:size] / size
    tone = 1 + 0.13 * rng.standard_normal((rows, columns))
    tone = tone[(y * rows).astype(int), (x * columns).astype(int)]
    curve = 0.75 + 0.25 * np.abs(np.sin(np.pi * x * columns))
    shadow = 1 - 0.55 * step((y * rows) % 1, 0.88, 0.15)
    moss = fractal((size, size), rng, smallest=6, largest=120)
    shade = tone * curve * shadow * (1 + 0.10 * moss)
    return np.clip(shade[..., None] * np.array([0.235, 0.115, 0.078]), 0.02, 0.5)


def roof_felt() -> Picture:
    """Bitumen and gravel of flat roofs, slate seen from afar; 2 m square."""
    rng = np.random.default_rng(26)
    shape = (128, 128)
    grain = fractal(shape, rng, smallest=2, largest=30, slope=0.5)
    return np.clip((1 + 0.18 * grain)[..., None] * np.array([0.088, 0.090, 0.096]), 0.02, 0.4)


def wood() -> Picture:
    """Painted boards of 12 cm, near white, to be tinted; 0.96 m square, boards along v."""
    rng = np.random.default_rng(27)
    shape = (128, 256)
    fibres = fractal(shape, rng, smallest=3, largest=40, slope=0.5, stretch=(8.0, 1.0))
    tone = 1 + 0.07 * rng.standard_normal(8)
    shade = 0.75 * tone[np.arange(256) // 32][None] * (1 + 0.07 * fibres)
    shade[:, np.arange(256) % 32 < 2] *= 0.4
    return np.clip(np.repeat(shade[..., None], 3, axis=2), 0.1, 1.0)
