import time

import cv2
import numpy as np
import pytest

from cnca.core.errors import GeneratorError
from cnca.gen import textures
from cnca.gen.palettes import COLOR_WORDS


@pytest.mark.parametrize("style", textures.STYLES)
@pytest.mark.parametrize("colors", ["", "colorful", "red", "yellow black", "desert"])
@pytest.mark.parametrize("scale", textures.SCALES)
def test_every_style_paints_every_palette(style, colors, scale):
    picture = textures.draw(style, colors, scale, np.random.default_rng(1))
    assert picture.shape == (256, 256, 3)
    assert np.isfinite(picture).all()
    assert -1e-6 <= picture.min() < picture.max() <= 1 + 1e-6
    assert picture.std() > 0.02


def test_the_seed_decides():
    one, same, other = (textures.sample(np.random.default_rng(s)) for s in (5, 5, 6))
    assert one.caption == same.caption
    assert np.array_equal(one.picture, same.picture)
    assert not np.array_equal(one.picture, other.picture)


def test_the_paper_s_prompts_are_held_out_as_wholes_but_not_as_words(monkeypatch):
    blank = np.zeros((256, 256, 3))
    monkeypatch.setattr(textures, "draw", lambda *_: blank)
    rng = np.random.default_rng(0)
    captions = {textures.sample(rng).caption for _ in range(6000)}
    assert captions.isdisjoint(textures.PAPER_PROMPTS)
    words = {word for caption in captions for word in caption.split()}
    assert words.issuperset(word for prompt in textures.PAPER_PROMPTS for word in prompt.split())


@pytest.mark.parametrize(
    ("colors", "hue"), [("red", 0), ("yellow", 50), ("green", 134), ("blue", 223)]
)
@pytest.mark.parametrize("style", ["camouflage", "waves", "marble", "mosaic"])
def test_color_words_give_their_hue(style, colors, hue):
    picture = textures.draw(style, colors, "", np.random.default_rng(2)).astype(np.float32)
    degrees, saturation, _ = cv2.split(cv2.cvtColor(picture, cv2.COLOR_RGB2HSV))
    strong = degrees[saturation > 0.4]
    away = np.abs((strong - hue + 180) % 360 - 180)
    assert np.median(away) < 12


def test_unknown_styles_are_named_with_the_nearest():
    with pytest.raises(GeneratorError, match="did you mean 'graffiti'"):
        textures.draw("grafiti", "", "", np.random.default_rng(0))
    assert "colorful" in COLOR_WORDS


def test_painting_is_fast_enough_to_train_from():
    rng = np.random.default_rng(0)
    start = time.process_time()
    for _ in range(30):
        textures.sample(rng)
    assert time.process_time() - start < 30 / 10
