"""Painted pictures of what lies on the ground, as linear reflectance; every one repeats."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float

from cnca.world.builtin.noise import fractal, mix, step

Picture = Float[np.ndarray, "height width 3"]

LANE_STRIPS = 4
"""Pieces of lane in the asphalt's picture, one above the other, each continuing the last."""


def asphalt() -> Picture:
    """Four pieces of lane, 13 m long and 3.25 m wide, of 1024 × 256 texels each."""
    rng = np.random.default_rng(1)
    across = np.linspace(-1.625, 1.625, 256)[:, None]
    strips = []
    for strip in range(LANE_STRIPS):
        shape = (256, 1024)
        # Where pieces meet they must look alike: slow features fade out towards both ends.
        ends = np.minimum(np.arange(1024), np.arange(1024)[::-1])[None] / 120
        inside = np.clip(ends, 0, 1)
        slow = inside * fractal(shape, rng, smallest=30, largest=300, slope=1.2)
        middle = fractal(shape, rng, smallest=5, largest=40, slope=1.0)
        grain = fractal(shape, rng, smallest=2, largest=4, slope=0.2)
        tracks = np.exp(-(((np.abs(across) - 0.78) / 0.24) ** 2))
        oil = np.exp(-((across / 0.22) ** 2))
        wear = 1 - (0.10 + 0.02 * slow) * tracks - (0.07 + 0.03 * slow) * oil
        shade = wear * (1 + 0.045 * slow + 0.03 * middle + 0.10 * grain)
        bright = step(fractal(shape, rng, smallest=2, largest=3, slope=0.0), 2.3, 0.4)
        shade = shade + 0.45 * bright
        for _ in range(strip):
            shade = shade * (1 - 0.6 * _crack(rng, shape))
        strips.append(shade)
    shade = np.concatenate(strips)[..., None]
    return np.clip(shade * np.array([0.128, 0.126, 0.122]), 0.02, 0.5)


def _crack(rng: np.random.Generator, shape: tuple[int, int]) -> Float[np.ndarray, "height width"]:
    """Coverage of one thin wandering crack that keeps off the picture's border."""
    height, width = shape
    steps = int(rng.integers(20, 60))
    turn = rng.uniform(0, 2 * np.pi) + 0.35 * rng.standard_normal(steps).cumsum()
    path = np.stack([np.cos(turn), np.sin(turn)], axis=1).cumsum(axis=0) * 8
    path = path - path.mean(axis=0) + [rng.uniform(0.3, 0.7) * width, 0.5 * height]
    path = np.clip(path, [130, 10], [width - 130, height - 10])
    canvas = np.zeros(shape, np.uint8)
    cv2.polylines(canvas, [np.round(path).astype(np.int32)], False, 255, 1, cv2.LINE_AA)
    return canvas.astype(np.float64) / 255


def road_paint() -> Picture:
    """Worn white marking over asphalt, 2 m square."""
    rng = np.random.default_rng(2)
    shape = (512, 512)
    worn = 0.8 * fractal(shape, rng, smallest=3, largest=60, slope=0.7)
    worn = worn + 0.6 * fractal(shape, rng, smallest=40, largest=400, slope=1.0)
    cover = 1 - 0.85 * step(worn, 1.25, 0.8)
    dirt = 1 + 0.06 * fractal(shape, rng, smallest=6, largest=200)
    paint = np.array([0.50, 0.50, 0.47]) * dirt[..., None]
    base = np.array([0.13, 0.13, 0.125])
    return np.clip(mix(np.broadcast_to(base, paint.shape), paint, cover), 0.05, 0.6)


def slabs() -> Picture:
    """Pavement of concrete slabs, 0.6 × 0.4 m in running bond; 4.8 m square."""
    rng = np.random.default_rng(3)
    size, columns, rows = 768, 8, 12
    y, x = np.mgrid[0:size, 0:size] / size
    row = (y * rows).astype(int)
    shifted = (x * columns + 0.5 * (row % 2)) % columns
    tone = 1 + 0.07 * rng.standard_normal((rows, columns))
    warm = 0.02 * rng.standard_normal((rows, columns))
    shade, tint = tone[row, shifted.astype(int)], warm[row, shifted.astype(int)]
    stained = fractal((size, size), rng, smallest=20, largest=500, slope=1.3)
    grain = fractal((size, size), rng, smallest=2, largest=6, slope=0.3)
    shade = shade * (1 + 0.06 * stained + 0.05 * grain)
    picture = shade[..., None] * np.array([0.285, 0.275, 0.255])
    picture = picture * (1 + tint[..., None] * np.array([1, 0, -1]))
    gap = np.minimum(_edge(shifted % 1) * size / columns, _edge((y * rows) % 1) * size / rows)
    picture = mix(np.broadcast_to([0.10, 0.095, 0.085], picture.shape), picture, step(gap, 1.6, 2))
    gum = step(fractal((size, size), rng, smallest=8, largest=12, slope=0.0), 3.1, 0.3)
    return np.clip(picture * (1 - 0.45 * gum[..., None]), 0.03, 0.6)


def _edge(fraction: np.ndarray) -> np.ndarray:
    """Distance to the nearer border of a cell, as a part of the cell."""
    return np.minimum(fraction, 1 - fraction)


def setts() -> Picture:
    """Small granite blocks of 10 cm, 1.6 m square."""
    rng = np.random.default_rng(4)
    size, count = 512, 16
    y, x = np.mgrid[0:size, 0:size] / size
    row = (y * count).astype(int)
    jitter = 0.15 * rng.uniform(-1, 1, count)
    shifted = (x * count + 0.5 * (row % 2) + jitter[row]) % count
    tone = (1 + 0.16 * rng.standard_normal((count, count)))[row, shifted.astype(int)]
    grain = fractal((size, size), rng, smallest=2, largest=8, slope=0.4)
    dome = step(np.minimum(_edge(shifted % 1), _edge((y * count) % 1)), 0.10, 0.14)
    picture = (tone * (1 + 0.07 * grain))[..., None] * np.array([0.185, 0.178, 0.170])
    return np.clip(
        mix(np.broadcast_to([0.06, 0.055, 0.048], picture.shape), picture, dome), 0.02, 1
    )


def kerb() -> Picture:
    """Granite kerb: one stone of 1 m with its joint; 1 m square."""
    rng = np.random.default_rng(5)
    shape = (256, 256)
    grain = fractal(shape, rng, smallest=2, largest=5, slope=0.2)
    slow = fractal(shape, rng, smallest=20, largest=250)
    shade = 1 + 0.10 * grain + 0.08 * slow
    shade[:, :3] *= 0.45
    return np.clip(shade[..., None] * np.array([0.30, 0.295, 0.285]), 0.03, 0.7)


def grass() -> Picture:
    """A lawn from above, 4 m square."""
    rng = np.random.default_rng(6)
    shape = (512, 512)
    blades = fractal(shape, rng, smallest=2, largest=10, slope=0.5)
    tufts = fractal(shape, rng, smallest=12, largest=80, slope=0.8)
    dry = step(fractal(shape, rng, smallest=16, largest=300, slope=1.0), 0.9, 1.6)
    picture = mix(
        np.broadcast_to([0.052, 0.088, 0.022], (*shape, 3)), np.array([0.13, 0.12, 0.05]), 0.6 * dry
    )
    return np.clip(picture * (1 + 0.30 * blades + 0.14 * tufts)[..., None], 0.008, 0.3)


def soil() -> Picture:
    """Bare earth with crumbs, 2 m square."""
    rng = np.random.default_rng(7)
    shape = (256, 256)
    crumbs = fractal(shape, rng, smallest=2, largest=30, slope=0.6)
    return np.clip((1 + 0.25 * crumbs)[..., None] * np.array([0.095, 0.070, 0.048]), 0.01, 0.3)


def gravel() -> Picture:
    """Fine light gravel of a verge or a path, 2 m square."""
    rng = np.random.default_rng(8)
    shape = (512, 512)
    stones = fractal(shape, rng, smallest=3, largest=9, slope=0.2)
    slow = fractal(shape, rng, smallest=40, largest=400)
    return np.clip(
        (1 + 0.26 * stones + 0.08 * slow)[..., None] * np.array([0.24, 0.22, 0.19]), 0.03, 0.6
    )


def leaves() -> Picture:
    """The colors of foliage; a leaf takes a few texels of it."""
    rng = np.random.default_rng(9)
    shape = (256, 256)
    light = fractal(shape, rng, smallest=3, largest=40, slope=0.5)
    yellow = step(fractal(shape, rng, smallest=4, largest=60, slope=0.5), 0.8, 1.5)
    green = np.broadcast_to([0.075, 0.135, 0.030], (*shape, 3))
    picture = mix(green, np.array([0.16, 0.185, 0.042]), 0.7 * yellow)
    return np.clip(picture * (1 + 0.28 * light)[..., None], 0.01, 0.35)


def bark() -> Picture:
    """Furrowed bark, 1 m square, furrows along v."""
    rng = np.random.default_rng(10)
    shape = (128, 128)
    furrows = fractal(shape, rng, smallest=3, largest=24, slope=0.5, stretch=(5.0, 1.0))
    return np.clip((1 + 0.28 * furrows)[..., None] * np.array([0.135, 0.110, 0.085]), 0.02, 0.4)
