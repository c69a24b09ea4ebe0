"""Paint goes where the mask is white and nowhere else."""

from __future__ import annotations

import pytest
import torch

from cnca.core.color import linear_to_srgb, srgb_to_linear
from cnca.scene.paint import Paint

SIZE = 16


@pytest.fixture
def paint() -> Paint:
    base = torch.rand(3, SIZE, SIZE, generator=torch.Generator().manual_seed(0))
    mask = torch.zeros(1, SIZE, SIZE)
    mask[:, :, : SIZE // 2] = 1
    return Paint(base, mask)


def test_the_plain_paint_is_the_base(paint):
    assert torch.equal(paint.apply(), srgb_to_linear(paint.base))


def test_the_texture_shows_under_the_mask_and_the_base_beside_it(paint):
    texture = torch.rand(3, SIZE, SIZE, generator=torch.Generator().manual_seed(1))
    shown = linear_to_srgb(paint.apply(texture))
    half = SIZE // 2
    torch.testing.assert_close(shown[..., :half], texture[..., :half], rtol=0, atol=1e-5)
    torch.testing.assert_close(shown[..., half:], paint.base[..., half:], rtol=0, atol=1e-5)


def test_a_half_white_mask_mixes_in_display_values(paint):
    grey = Paint(torch.zeros(3, SIZE, SIZE), torch.full((1, SIZE, SIZE), 0.5))
    shown = linear_to_srgb(grey.apply(torch.full((3, SIZE, SIZE), 0.8)))
    torch.testing.assert_close(shown, torch.full_like(shown, 0.4))


@pytest.mark.parametrize("size", [(4, 4), (64, 64), (10, 30)])
def test_textures_of_any_size_are_fitted(paint, size):
    flat = torch.full((3, *size), 0.3)
    albedo = paint.apply(flat)
    assert albedo.shape == (3, SIZE, SIZE)
    expected = srgb_to_linear(torch.tensor(0.3)).expand(3, SIZE, SIZE // 2)
    torch.testing.assert_close(albedo[..., : SIZE // 2], expected)


def test_shrinking_averages_instead_of_skipping_texels():
    """Stripes that are finer than the texture become their mean, not one of the stripes."""
    stripes = torch.zeros(3, 8 * SIZE, 8 * SIZE)
    stripes[..., ::2] = 1
    everywhere = Paint(torch.zeros(3, SIZE, SIZE), torch.ones(1, SIZE, SIZE))
    shown = linear_to_srgb(everywhere.apply(stripes))
    inside = shown[..., 1:-1, 1:-1]  # the filter is cut off at the border
    torch.testing.assert_close(inside, torch.full_like(inside, 0.5), rtol=0, atol=0.01)


def test_the_gradient_reaches_the_painted_texels_alone(paint):
    texture = torch.full((3, SIZE, SIZE), 0.5, requires_grad=True)
    paint.apply(texture).sum().backward()
    assert (texture.grad[..., : SIZE // 2] > 0).all()
    assert (texture.grad[..., SIZE // 2 :] == 0).all()


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_albedo_stays_within_the_unit_range_at_both_ends(paint, value):
    albedo = paint.apply(torch.full((3, 5, 5), value))
    assert 0 <= albedo.min() <= albedo.max() <= 1 + 1e-6
