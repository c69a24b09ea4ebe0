"""Control textures: the right palette, and nothing left of the design."""

from __future__ import annotations

import pytest
import torch

from cnca.scene.controls import random_blocks, shuffled, uniform


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def texels(texture: torch.Tensor) -> list[tuple[float, ...]]:
    """The multiset of colours, sorted."""
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


def test_shuffling_cuts_a_size_that_is_no_multiple():
    texture = torch.rand(3, 35, 35, generator=generator(1))
    found = shuffled(texture, generator(), blocks=16)
    assert found.shape == (3, 32, 32)
    assert texels(found) == texels(texture[:, :32, :32])


@pytest.mark.parametrize("make", [uniform, random_blocks])
def test_random_textures_lie_in_the_unit_range_and_follow_their_seed(make):
    texture = make(44, generator(3))
    assert texture.shape == (3, 44, 44)
    assert 0 <= texture.min() <= texture.max() <= 1
    assert torch.equal(texture, make(44, generator(3)))
    assert not torch.equal(texture, make(44, generator(4)))


def test_a_uniform_texture_has_one_colour_and_blocks_have_many():
    assert len(set(texels(uniform(20, generator())))) == 1
    assert len(set(texels(random_blocks(44, generator(), blocks=11)))) == 121
    squares = random_blocks(44, generator(), blocks=11).reshape(3, 11, 4, 11, 4)
    assert torch.equal(squares.amin((2, 4)), squares.amax((2, 4)))
