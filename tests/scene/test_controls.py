"""Control textures: the right palette, and nothing left of the design."""

from __future__ import annotations

import pytest
import torch
import torch.nn.functional as F

from cnca.core.color import srgb_to_linear
from cnca.scene.controls import mean_color, mirrored, random_blocks, shuffled, uniform


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def texels(texture: torch.Tensor) -> list[tuple[float, ...]]:
    """The multiset of colors, sorted."""
    return sorted(map(tuple, texture.flatten(1).T.tolist()))


@pytest.mark.parametrize(("size", "blocks"), [(32, 16), (48, 4), (64, 64), (5, 1)])
def test_shuffling_keeps_every_texel(size, blocks):
    texture = torch.rand(3, size, size, generator=generator(1))
    found = shuffled(texture, generator(), blocks=blocks)
    assert found.shape == texture.shape
    assert texels(found) == texels(texture)


def test_shuffling_moves_whole_blocks():
    """A picture that numbers its blocks and, in another channel, the texels within a block."""
    block = torch.arange(16.0).reshape(4, 4).repeat_interleave(8, 0).repeat_interleave(8, 1)
    within = torch.arange(64.0).reshape(8, 8).repeat(4, 4)
    texture = torch.stack([block, within, torch.zeros(32, 32)])
    found = shuffled(texture, generator(), blocks=4)
    assert torch.equal(found[1], within)
    numbers = found[0].reshape(4, 8, 4, 8)
    assert torch.equal(numbers.amin((1, 3)), numbers.amax((1, 3)))
    assert not torch.equal(found[0], block)


def test_shuffling_leaves_a_border_that_is_no_whole_block():
    texture = torch.rand(3, 35, 35, generator=generator(1))
    made = shuffled(texture, generator(), blocks=16)
    assert texels(made[:, :34, :34]) == texels(texture[:, :34, :34])
    assert torch.equal(made[:, 34:], texture[:, 34:])
    assert not torch.equal(made, texture)


def painted_in_red() -> tuple[torch.Tensor, torch.Tensor]:
    """Shades of red on paint, a disc and a thin bar, and green everywhere else."""
    rows, columns = torch.meshgrid(torch.arange(128), torch.arange(128), indexing="ij")
    mask = ((rows - 50) ** 2 + (columns - 70) ** 2 < 40**2) | ((rows > 110) & (rows < 114))
    texture = torch.zeros(3, 128, 128)
    texture[0] = torch.where(mask, 0.5 + 0.5 * torch.rand(128, 128, generator=generator(1)), 0)
    texture[1] = (~mask).float()
    return texture, mask[None].float()


@pytest.mark.parametrize("blocks", [4, 16, 64])
def test_with_a_mask_only_what_is_painted_comes_onto_paint(blocks):
    texture, mask = painted_in_red()
    for made in (
        shuffled(texture, generator(), blocks=blocks, mask=mask),
        mirrored(texture, generator(), mask),
        mean_color(texture, mask),
    ):
        on_paint = made[:, mask[0] > 0.5]
        assert (on_paint[1] == 0).all()
        assert (on_paint[0] >= 0.5).all()
    without = shuffled(texture, generator(), blocks=blocks)
    assert (without[1, mask[0] > 0.5] > 0).any()  # the check sees what it is to see


def test_with_a_mask_whole_blocks_of_paint_change_places():
    texture, mask = painted_in_red()
    made = shuffled(texture, generator(), mask=mask)
    inner = F.avg_pool2d(mask, 8)[0] == 1
    whole = inner.repeat_interleave(8, 0).repeat_interleave(8, 1)
    assert inner.sum() > 20
    assert texels(made[:, whole]) == texels(texture[:, whole])
    assert not torch.equal(made[:, whole], texture[:, whole])
    assert torch.equal(made[:, mask[0] == 0][:, :5], texture[:, mask[0] == 0][:, :5])


def test_blocks_are_halved_until_paint_holds_them():
    """Stripes of four texels: no block of eight lies within one."""
    mask = ((torch.arange(64) // 4) % 2 == 0).float().expand(1, 64, 64)
    texture = torch.rand(3, 64, 64, generator=generator(1))
    texture = torch.where(mask > 0.5, texture, torch.ones(3, 64, 64) * 2)
    made = shuffled(texture, generator(), blocks=8, mask=mask)
    assert made[:, mask[0] > 0.5].max() <= 1
    assert texels(made) == texels(texture)


def test_paint_that_is_nowhere_is_taken_for_everywhere():
    texture, nowhere = torch.rand(3, 32, 32, generator=generator()), torch.zeros(1, 32, 32)
    assert texels(shuffled(texture, generator(), mask=nowhere)) == texels(texture)


def test_a_mirror_image_is_the_flip_where_both_sides_are_paint():
    texture, mask = painted_in_red()
    assert torch.equal(mirrored(texture, generator()), texture.flip(-1))
    made = mirrored(texture, generator(), mask)
    both = (mask[0] > 0.5) & (mask[0].flip(-1) > 0.5)
    assert torch.equal(made[:, both], texture.flip(-1)[:, both])


def test_the_mean_color_gives_back_as_much_light():
    texture, mask = painted_in_red()
    made = mean_color(texture, mask)
    one, other = (srgb_to_linear(x)[0, mask[0] > 0.5].mean() for x in (texture, made))
    assert one.item() == pytest.approx(other.item(), rel=1e-5)
    assert len(set(texels(made))) == 1


@pytest.mark.parametrize("make", [uniform, random_blocks])
def test_random_textures_lie_in_the_unit_range_and_follow_their_seed(make):
    texture = make(44, generator(3))
    assert texture.shape == (3, 44, 44)
    assert 0 <= texture.min() <= texture.max() <= 1
    assert torch.equal(texture, make(44, generator(3)))
    assert not torch.equal(texture, make(44, generator(4)))


def test_a_uniform_texture_has_one_color_and_blocks_have_many():
    assert len(set(texels(uniform(20, generator())))) == 1
    assert len(set(texels(random_blocks(44, generator(), blocks=11)))) == 121
    squares = random_blocks(44, generator(), blocks=11).reshape(3, 11, 4, 11, 4)
    assert torch.equal(squares.amin((2, 4)), squares.amax((2, 4)))
