"""Color words of the captions and the colors they stand for."""

from __future__ import annotations

import colorsys
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

Palette: TypeAlias = Float[np.ndarray, "colors 3"]
"""sRGB colors in [0, 1]; the first one serves as the ground where a style has a ground."""

BASE_COLORS = {
    "red": "d01c1c",
    "orange": "f58216",
    "yellow": "fad81e",
    "green": "1f9a3c",
    "blue": "1c50cf",
    "purple": "7a2cb4",
    "pink": "f47cb4",
    "brown": "7a4a22",
    "black": "101012",
    "white": "f4f4f2",
    "gray": "808388",
}
"""Words that name one color, and may be joined in pairs as in "yellow black"."""

THEMES = {
    "desert": ("d9bd8b", "b5905a", "8a6a42", "ecdcb8"),
    "forest": ("2f4a25", "5c7537", "1b2a18", "6b5030"),
    "ocean": ("0b3c6f", "1e7fa8", "6cc5c9", "d5f0ea"),
    "sunset": ("5b2166", "c7365c", "f77f3b", "fcc65a"),
    "winter": ("eef3f7", "b9c9d8", "7e93a8", "4c5b6b"),
    "pastel": ("f8c9d4", "c9e4f8", "d5f3cf", "fdf3c4"),
}
"""Words that name a set of colors."""

COLORFUL = "colorful"
COLOR_WORDS = (COLORFUL, *BASE_COLORS, *THEMES)


def palette(words: str, rng: np.random.Generator) -> Palette:
    """Return jittered colors for ``words``: "colorful", a theme, or one or two base colors."""
    if words == COLORFUL:
        colors = _spread_hues(rng)
    elif words in THEMES:
        colors = np.stack([_rgb(code) for code in THEMES[words]])
    else:
        named = [_rgb(BASE_COLORS[word]) for word in words.split()]
        colors = np.stack(named) if len(named) > 1 else _shades(named[0])
    if words in THEMES or words == COLORFUL:
        rng.shuffle(colors)
    return np.clip(colors + rng.normal(0.0, 0.02, colors.shape), 0.0, 1.0).astype(np.float32)


def _rgb(code: str) -> Float[np.ndarray, "3"]:
    return np.array([int(code[i : i + 2], 16) for i in (0, 2, 4)]) / 255.0


def _shades(color: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """The color itself, a darker and a lighter one, so that one word still makes a pattern."""
    return np.stack([color, 0.45 * color, color + 0.5 * (1.0 - color)])


def _spread_hues(rng: np.random.Generator) -> Float[np.ndarray, "5 3"]:
    """Five saturated hues spread around the color wheel."""
    hues = (rng.random() + np.arange(5) / 5 + rng.uniform(-0.04, 0.04, 5)) % 1.0
    values = rng.uniform([0.75, 0.8], [1.0, 1.0], (5, 2))
    return np.array([colorsys.hsv_to_rgb(h, s, v) for h, (s, v) in zip(hues, values, strict=True)])
