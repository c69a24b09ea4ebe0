"""The generator in cnca/assets: it must follow prompts and give F_adv a grip on the picture."""

import pytest
import torch

from cnca.gen.feature import initial
from cnca.gen.pipeline import SHIPPED
from cnca.gen.sampling import DiffusionTextureGenerator
from cnca.gen.textures import PAPER_PROMPTS


@pytest.fixture(scope="module")
def shipped() -> DiffusionTextureGenerator:
    return DiffusionTextureGenerator.load()


def paint(generator, prompt, feature=None, seed=0):
    noise = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        return generator.generate(generator.encode(prompt), feature, noise)


def test_it_is_small_and_holds_no_code():
    files = [file for file in SHIPPED.rglob("*") if file.is_file()]
    assert sum(file.stat().st_size for file in files) < 18e6
    assert {file.suffix for file in files} <= {".json", ".safetensors", ".md", ".txt"}


@pytest.mark.parametrize(("word", "channel"), [("red", 0), ("green", 1), ("blue", 2)])
def test_colour_words_colour_the_picture(shipped, word, channel):
    means = paint(shipped, f"{word} camouflage").mean(dim=(1, 2))
    others = [means[c] for c in range(3) if c != channel]
    assert means[channel] > max(others) + 0.1


def test_the_paper_s_prompts_give_different_textures(shipped):
    pictures = [paint(shipped, prompt) for prompt in PAPER_PROMPTS]
    for i, one in enumerate(pictures):
        for other in pictures[:i]:
            assert (one - other).abs().mean() > 0.1


def test_yellow_black_graffiti_is_yellow_and_black(shipped):
    red, green, blue = paint(shipped, "yellow black graffiti")
    yellow = (red > 0.6) & (green > 0.5) & (blue < 0.4)
    black = (red < 0.3) & (green < 0.3) & (blue < 0.3)
    assert yellow.float().mean() > 0.1
    assert black.float().mean() > 0.1


def test_the_feature_has_a_grip_that_grows_with_tau(shipped):
    plain = paint(shipped, "colorful camouflage", initial(shipped.feature_shape))
    signs = torch.randn(shipped.feature_shape, generator=torch.Generator().manual_seed(1)).sign()
    changes = [
        (paint(shipped, "colorful camouflage", tau * signs) - plain).abs().mean().item()
        for tau in (0.25, 1.0)
    ]
    assert 0.0 < changes[0] < changes[1]
    assert changes[1] > 0.05
