"""Textures against which a camouflage must prove itself.

A loud texture fools weak detectors without any attack: so each candidate is compared with random
blocks and with itself cut up and shuffled, which has the same palette and loses the design.
"""

from __future__ import annotations

import torch

from cnca.core.types import SrgbTexture


def uniform(size: int, generator: torch.Generator) -> SrgbTexture:
    """One random colour, (3, size, size)."""
    return torch.rand(3, 1, 1, generator=generator).expand(3, size, size).clone()


def random_blocks(size: int, generator: torch.Generator, *, blocks: int = 11) -> SrgbTexture:
    """``blocks`` × ``blocks`` squares of random colours, (3, size, size)."""
    colors = torch.rand(1, 3, blocks, blocks, generator=generator)
    return torch.nn.functional.interpolate(colors, size=(size, size), mode="nearest")[0]


def shuffled(texture: SrgbTexture, generator: torch.Generator, *, blocks: int = 16) -> SrgbTexture:
    """``texture`` cut into ``blocks`` × ``blocks`` squares that are put back in random order.

    The size is cut down to a multiple of ``blocks``.
    """
    side = texture.shape[-1] // blocks
    tiles = texture[:, : side * blocks, : side * blocks].reshape(3, blocks, side, blocks, side)
    tiles = tiles.permute(1, 3, 0, 2, 4).reshape(blocks * blocks, 3, side, side)
    tiles = tiles[torch.randperm(blocks * blocks, generator=generator)]
    tiles = tiles.reshape(blocks, blocks, 3, side, side).permute(2, 0, 3, 1, 4)
    return tiles.reshape(3, side * blocks, side * blocks)
