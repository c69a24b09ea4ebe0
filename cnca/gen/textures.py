"""Captioned procedural textures: what the shipped generator learns from.

A caption is a scale word, color words and a style word, each but the style optional, as in
"large yellow black graffiti".  Every picture follows from the random generator that is given.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cnca.core.errors import GeneratorError, did_you_mean
from cnca.gen import patterns
from cnca.gen.palettes import BASE_COLORS, COLOR_WORDS, COLORFUL, palette
from cnca.gen.patterns import Pattern, Picture

PAPER_PROMPTS = (
    "colorful graffiti",
    "yellow black graffiti",
    "colorful camouflage",
    "colorful balls",
    "snake texture",
    "zebra strips",
)
"""The paper's table of prompts; never a whole caption in training, so they test composition."""

SCALES = {"small": 44.0, "": 64.0, "large": 92.0}
"""Scale words and the pattern's typical size in pixels of 256: several latents of 8 pixels each."""


@dataclass(frozen=True)
class Style:
    """One pattern with the nouns that captions call it by."""

    pattern: Pattern
    nouns: tuple[str, ...]
    natural: str = COLORFUL
    """Color words that hold when a caption names none."""


STYLES = {
    "graffiti": Style(patterns.graffiti, ("graffiti", "graffiti texture")),
    "camouflage": Style(patterns.camouflage, ("camouflage", "camouflage texture"), "forest"),
    "balls": Style(patterns.balls, ("balls", "balls texture")),
    "dots": Style(patterns.dots, ("polka dots", "polka dots texture")),
    "snake": Style(patterns.snake, ("snake texture", "snake skin"), "green brown"),
    "zebra": Style(
        patterns.zebra, ("zebra strips", "zebra stripes", "zebra texture"), "black white"
    ),
    "stripes": Style(patterns.stripes, ("stripes", "strips")),
    "plaid": Style(patterns.plaid, ("plaid", "plaid texture")),
    "waves": Style(patterns.waves, ("waves", "waves texture"), "ocean"),
    "leaves": Style(patterns.leaves, ("leaves", "leaves texture"), "green"),
    "flames": Style(patterns.flames, ("flames", "flames texture"), "red yellow"),
    "bricks": Style(patterns.bricks, ("bricks", "brick texture"), "red"),
    "marble": Style(patterns.marble, ("marble", "marble texture"), "white gray"),
    "clouds": Style(patterns.clouds, ("clouds", "clouds texture"), "blue white"),
    "leopard": Style(patterns.leopard, ("leopard", "leopard skin"), "orange black"),
    "mosaic": Style(patterns.mosaic, ("mosaic", "mosaic texture")),
}


@dataclass(frozen=True)
class CaptionedTexture:
    """A picture, sRGB in [0, 1], shape (256, 256, 3), and the words that describe it."""

    picture: Picture
    caption: str


def draw(style: str, colors: str, scale: str, rng: np.random.Generator) -> Picture:
    """Paint ``style`` in ``colors`` ("" for its natural ones) at ``scale`` ("" for medium).

    Raises :class:`GeneratorError` for an unknown style.
    """
    if style not in STYLES:
        raise GeneratorError(f"unknown texture style '{style}'{did_you_mean(style, STYLES)}")
    chosen = STYLES[style]
    cell = SCALES[scale] * rng.uniform(0.85, 1.18)
    return chosen.pattern(rng, palette(colors or chosen.natural, rng), cell)


def sample(rng: np.random.Generator) -> CaptionedTexture:
    """Draw a random texture whose caption is none of :data:`PAPER_PROMPTS`."""
    while True:
        style = str(rng.choice(list(STYLES)))
        colors, scale = _color_words(rng), str(rng.choice(["small", "", "", "large"]))
        noun = str(rng.choice(STYLES[style].nouns))
        caption = " ".join(filter(None, (scale, colors, noun)))
        if caption not in PAPER_PROMPTS:
            return CaptionedTexture(draw(style, colors, scale, rng), caption)


def _color_words(rng: np.random.Generator) -> str:
    """None (10 %), a single word (50 %, a fifth of them "colorful") or a pair of base colors."""
    kind = rng.random()
    if kind < 0.1:
        return ""
    if kind < 0.2:
        return COLORFUL
    if kind < 0.6:
        return str(rng.choice(COLOR_WORDS[1:]))
    return " ".join(rng.choice(list(BASE_COLORS), 2, replace=False))
