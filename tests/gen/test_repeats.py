"""What repeats has no seams, and everything that the sampler promises holds for it, too."""

import numpy as np
import pytest
import torch

from cnca.core.errors import GeneratorError
from cnca.gen.repeats import rolled, rolled_back, shift, tiled, wrapped
from cnca.gen.sampling import DiffusionTextureGenerator


def texture_of(generator, seed=0):
    noises = torch.randn(generator.noise_shape, generator=torch.Generator().manual_seed(seed))
    with torch.no_grad():
        rng = torch.Generator().manual_seed(seed)
        return generator.generate(generator.encode("zebra strips"), None, rng, noises=noises)


def test_a_roll_and_its_inverse_leave_nothing():
    latents = torch.randn(1, 4, 8, 8)
    for step in range(20):
        by = shift(step, latents)
        assert torch.equal(rolled_back(rolled(latents, by), by), latents)


def test_the_shifts_go_everywhere():
    latents = torch.zeros(1, 4, 32, 32)
    shifts = np.array([shift(step, latents) for step in range(16)])
    for axis in shifts.T:  # each quarter of the circle is met by nearly its share
        assert (np.histogram(axis, bins=4, range=(0, 32))[0] >= 3).all()


def test_margins_are_the_other_side():
    latents = torch.arange(64.0).reshape(1, 1, 8, 8)
    decoded = wrapped(latents)[0].repeat_interleave(2, 1).repeat_interleave(2, 2)
    once = latents[0].repeat_interleave(2, 1).repeat_interleave(2, 2)
    assert torch.equal(tiled(decoded, 2, 3), once.repeat(1, 3, 3))


def test_repeats_are_the_same_and_tile_the_texture(tiny):
    generator = DiffusionTextureGenerator(tiny, tokens=2, steps=3).repeating(3)
    texture = texture_of(generator)
    side = texture.shape[-1] // 3
    assert torch.equal(texture, texture[:, :side, :side].repeat(1, 3, 3))


def test_the_shipped_model_leaves_no_seam():
    generator = DiffusionTextureGenerator.load(steps=8)
    once, repeated = (texture_of(g).double() for g in (generator, generator.repeating(2)))
    side = once.shape[-1]

    def across(texture):  # how display values jump between two columns, root mean square
        return texture.diff(dim=-1).square().mean(dim=(0, 1)).sqrt()

    inside = across(repeated)[: side - 1]
    assert across(repeated)[side - 1] < inside.max()  # the border is no worse than other columns
    assert across(once.repeat(1, 1, 2))[side - 1] > 2 * inside.max()  # it was one before


def test_gradients_of_the_noises_agree_with_finite_differences(tiny):
    for part in (tiny.vae, tiny.unet, tiny.text_encoder):
        part.double()
    generator = DiffusionTextureGenerator(tiny, tokens=2, steps=3, guidance=2.5).repeating(2)
    text = generator.encode("zebra strips")
    rng = torch.Generator().manual_seed(1)
    noises = torch.randn(generator.noise_shape, generator=rng, dtype=torch.float64)
    direction = torch.randn(noises.shape, generator=rng, dtype=torch.float64)

    def score(values):
        texture = generator.generate(text, None, torch.Generator(), noises=values)
        weights = torch.linspace(0, 1, texture.numel(), dtype=torch.float64).view_as(texture)
        return (texture * weights).mean()

    noises.requires_grad_()
    [gradient] = torch.autograd.grad(score(noises), noises)
    h = 1e-5
    with torch.no_grad():
        difference = (score(noises + h * direction) - score(noises - h * direction)) / (2 * h)
    assert (gradient * direction).sum().item() == pytest.approx(difference.item(), rel=1e-5)


def test_no_repeats_are_refused(tiny):
    with pytest.raises(GeneratorError, match="repeats is 0"):
        DiffusionTextureGenerator(tiny, repeats=0)
