"""White noise passes, and what is none is told from it."""

import pytest
import torch
import torch.nn.functional as F

from cnca.gen.noise import draw, low_frequency_excess, standardized

SHAPE = (4, 6, 64, 64)


def white(seed: int = 0) -> torch.Tensor:
    return draw(SHAPE, torch.Generator().manual_seed(seed))


def test_standardised_channels_have_mean_0_and_variance_1():
    made = standardized(3 * white() + 2)
    assert torch.allclose(made.mean(dim=(2, 3)), torch.zeros(4, 6), atol=1e-5)
    assert torch.allclose(made.var(dim=(2, 3), correction=0), torch.ones(4, 6), atol=1e-5)
    assert torch.allclose(made, standardized(made), atol=1e-5)


def test_a_channel_without_variation_becomes_0_and_has_a_finite_gradient():
    flat = torch.full(SHAPE, 7.0, requires_grad=True)
    made = standardized(flat)
    made.sum().backward()
    assert (made == 0).all()
    assert flat.grad.isfinite().all()


def test_white_noise_costs_its_chance_alone():
    """With n pooled values the mean of their squares is off by about √(2/n)."""
    for seed in range(4):
        chance = sum((2 / (6 * (64 // k) ** 2)) ** 0.5 for k in (2, 4, 8))
        assert 0 <= low_frequency_excess(white(seed)) < 2 * chance


def test_blocks_cost_what_the_formula_says():
    """Blocks of 2×2: pooled over k they keep 4/k² of the variance, 3 too much for each k ≥ 2."""
    blocks = F.interpolate(white()[..., ::2, ::2], scale_factor=2, mode="nearest")
    assert low_frequency_excess(blocks).item() == pytest.approx(9, rel=0.2)


def test_the_penalty_counts_every_draw_for_itself():
    """An x_T of blocks is not made up for by steps whose noise has none."""
    mixed = white()
    mixed[0] = F.interpolate(mixed[:1, :, ::2, ::2], scale_factor=2, mode="nearest")[0]
    fine = mixed.clone()
    fine[1:] = fine[1:] - F.interpolate(F.avg_pool2d(fine[1:], 2), scale_factor=2)
    assert low_frequency_excess(fine).item() == pytest.approx(9 / 4, rel=0.2)


def test_its_gradient_agrees_with_finite_differences():
    noises = draw((2, 1, 8, 8), torch.Generator().manual_seed(1)).double() + 0.3 * torch.ones(8, 8)
    noises = F.avg_pool2d(noises, 3, stride=1, padding=1).requires_grad_()
    assert low_frequency_excess(noises) > 0.1
    assert torch.autograd.gradcheck(low_frequency_excess, (noises,))


def test_latents_smaller_than_a_block():
    assert low_frequency_excess(torch.randn(2, 1, 1, 1)) == 0
    assert low_frequency_excess(torch.randn(2, 1, 4, 4)).isfinite()
