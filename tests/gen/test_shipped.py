"""The generator in cnca/assets: what it can do, and what its model card says that it cannot."""

import functools
import shutil

import numpy as np
import pytest
import torch

from cnca.gen import textures
from cnca.gen.feature import initial, project
from cnca.gen.pipeline import SHIPPED, load_pipeline
from cnca.gen.sampling import DiffusionTextureGenerator
from cnca.gen.scorer import load_scorer

STYLES = ("colorful graffiti", "colorful camouflage", "colorful balls")


@pytest.fixture(scope="module")
def shipped() -> DiffusionTextureGenerator:
    return DiffusionTextureGenerator.load()


def paint(generator, prompt, feature=None, seed=0):
    noise = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        return generator.generate(generator.encode(prompt), feature, noise)


@pytest.fixture(scope="module")
def painting(shipped):
    """Prompt and seed → their texture without an attack, generated once."""
    return functools.cache(lambda prompt, seed: paint(shipped, prompt, seed=seed))


def test_it_is_small_and_holds_no_code():
    files = [file for file in SHIPPED.rglob("*") if file.is_file()]
    assert sum(file.stat().st_size for file in files) < 18e6
    assert {file.suffix for file in files} <= {".json", ".safetensors", ".md", ".txt"}


@pytest.fixture(scope="module")
def painted() -> torch.Tensor:
    """Textures of the kind that it was trained on, (16, 3, 256, 256) in [0, 1]."""
    drawn = [textures.sample(np.random.default_rng([9, i])).picture for i in range(16)]
    return torch.from_numpy(np.stack(drawn)).permute(0, 3, 1, 2).float().clamp(0.0, 1.0)


def test_latents_have_the_deviation_of_the_noise(painted):
    """As the schedule takes for granted; and the autoencoder gives back what it got."""
    vae = load_pipeline(SHIPPED).vae
    means = vae.encode(2.0 * painted - 1.0).latent_dist.mean
    assert 0.8 < (vae.config["scaling_factor"] * means[:, :4]).std() < 1.2
    assert (vae.decode(means).sample / 2 + 0.5 - painted).abs().mean() < 0.04


def test_colors_are_as_muted_as_those_it_was_trained_on(painting, painted):
    def at_the_ends(pictures: torch.Tensor) -> float:
        return ((pictures == 0) | (pictures == 1)).float().mean().item()

    made = torch.stack([painting(f"colorful {noun}", 2) for noun in ("balls", "plaid")])
    assert at_the_ends(painted) < 0.05
    assert at_the_ends(made) < 0.25  # it was 0.6 when its latents were scaled wrongly


@pytest.mark.parametrize(("word", "channel"), [("red", 0), ("green", 1), ("blue", 2)])
def test_color_words_color_the_picture(painting, word, channel):
    means = painting(f"{word} camouflage", 0).mean(dim=(1, 2))
    others = [means[c] for c in range(3) if c != channel]
    assert means[channel] > max(others) + 0.1


def distance(one, other) -> float:
    return (one - other).abs().mean().item()


def test_prompts_of_other_colors_give_other_textures(painting):
    prompts = ("colorful graffiti", "yellow black graffiti", "snake texture", "zebra strips")
    pictures = [painting(prompt, 0) for prompt in prompts]
    for i, one in enumerate(pictures):
        assert all(distance(one, other) > 0.1 for other in pictures[:i])


def test_yellow_black_graffiti_is_mostly_yellow(painting):
    red, green, blue = painting("yellow black graffiti", 0)
    yellow = (red > 0.6) & (green > 0.5) & (blue < 0.4)
    assert yellow.float().mean() > 0.3


def climb(quantity, steps):
    """What ``quantity`` of the texture becomes from step to step of F_adv along its gradient."""
    generator = DiffusionTextureGenerator.load(steps=6)
    text = generator.encode("colorful camouflage")
    feature, values = initial(generator.feature_shape), []
    for _ in range(steps):
        feature.requires_grad_()
        value = quantity(generator.generate(text, feature, torch.Generator().manual_seed(0)))
        (gradient,) = torch.autograd.grad(value, feature)
        feature = project((feature + 0.2 * gradient.sign()).detach(), 1.0)
        values.append(value.item())
    return values


def test_a_few_steps_along_the_gradient_darken_the_picture():
    darkness = climb(lambda texture: -texture.mean(), 4)
    assert darkness[-1] > 0.6 * darkness[0]


@pytest.mark.parametrize("seed", [0, 1])
def test_another_network_tells_its_styles_apart(painting, seed):
    pictures = torch.stack([painting(prompt, seed) for prompt in STYLES])
    best = load_scorer(None).score(pictures, STYLES).argmax(dim=1)
    assert [STYLES[i] for i in best.tolist()] == list(STYLES)


def test_the_grip_grows_with_tau(shipped):
    noise = torch.randn(shipped.feature_shape, generator=torch.Generator().manual_seed(1))
    still = paint(shipped, "colorful camouflage", initial(shipped.feature_shape))
    small, large = (
        distance(still, paint(shipped, "colorful camouflage", tau * noise.sign()))
        for tau in (0.25, 1.0)
    )
    assert large > 1.5 * small


def test_a_few_steps_along_the_gradient_brighten_one_half_only():
    def contrast(texture):
        left, right = texture.chunk(2, dim=2)
        return right.mean() - left.mean()

    values = climb(contrast, 5)
    assert values[-1] > values[0] + 0.1


def test_a_folder_of_the_fp16_variant_is_read(tmp_path):
    """Diffusers' names of such weights; the texture is that of the folder without."""
    folder = tmp_path / "fp16"
    shutil.copytree(SHIPPED, folder)
    for file in folder.rglob("*model.safetensors"):
        file.rename(file.with_name(file.name.replace(".safetensors", ".fp16.safetensors")))
    loaded, shipped = (load_pipeline(path) for path in (folder, SHIPPED))
    for one, other in zip(loaded.unet.parameters(), shipped.unet.parameters(), strict=True):
        assert torch.equal(one, other)
