"""Textures against which a camouflage must prove itself.

A loud texture fools weak detectors without any attack: so each candidate is compared with random
blocks, with one color of its mean, with its mirror image, and with itself cut up and shuffled,
which has the same palette and loses the design.

A texture's picture also has texels that lie on no paint; they never are on the vehicle.  ``mask``,
(1, height, width), is above one half where there is paint: a control shows nothing else.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from cnca.core.color import linear_to_srgb, srgb_to_linear
from cnca.core.types import LinearTexture, SrgbTexture

Mask = Float[Tensor, "1 height width"]


def uniform(size: int, generator: torch.Generator) -> SrgbTexture:
    """One random color, (3, size, size)."""
    return SrgbTexture(torch.rand(3, 1, 1, generator=generator).expand(3, size, size).clone())


def random_blocks(size: int, generator: torch.Generator, *, blocks: int = 11) -> SrgbTexture:
    """``blocks`` × ``blocks`` squares of random colors, (3, size, size)."""
    colors = torch.rand(1, 3, blocks, blocks, generator=generator)
    return SrgbTexture(F.interpolate(colors, size=(size, size), mode="nearest")[0])


def mean_color(texture: SrgbTexture, mask: Mask | None = None) -> SrgbTexture:
    """The mean color of the painted texels all over: as much light comes back, and no pattern.

    The mean is that of linear light.
    """
    linear = srgb_to_linear(texture)[:, _painted(texture, mask)].mean(dim=1)
    one_texel = linear_to_srgb(LinearTexture(linear[:, None, None]))
    return SrgbTexture(one_texel.expand(texture.shape).clone())


def mirrored(
    texture: SrgbTexture, generator: torch.Generator, mask: Mask | None = None
) -> SrgbTexture:
    """``texture`` flipped left to right: the same design in other places.

    Where the flip would bring texels that are on no paint, those of :func:`shuffled` stand.
    """
    painted = _painted(texture, mask)
    filled = shuffled(texture, generator, mask=mask)
    return SrgbTexture(torch.where(painted.flip(-1), texture.flip(-1), filled))


def shuffled(
    texture: SrgbTexture,
    generator: torch.Generator,
    *,
    blocks: int = 16,
    mask: Mask | None = None,
) -> SrgbTexture:
    """``texture`` cut into ``blocks`` × ``blocks`` squares that are put back in random order.

    Squares that are paint throughout change places.  A square that is paint in part shows one of
    these, drawn at random; one without paint stays.  Squares are halved until those within the
    paint hold at least a quarter of it.  A border that is no whole square stays as it is.
    """
    painted, result = _painted(texture, mask), texture.clone()
    side = _side(painted, max(1, min(texture.shape[-2:]) // blocks))
    rows, columns = texture.shape[-2] // side, texture.shape[-1] // side
    within = texture[:, : rows * side, : columns * side]
    tiles = within.unflatten(1, (rows, side)).unflatten(3, (columns, side))
    tiles = tiles.permute(1, 3, 0, 2, 4).flatten(0, 1)
    share = _shares(painted, side).flatten()
    inner, edge = torch.where(share == 1)[0], torch.where((share > 0) & (share < 1))[0]
    if len(inner) == 0:
        return SrgbTexture(result)
    moved = tiles.clone()
    moved[inner] = tiles[inner[torch.randperm(len(inner), generator=generator)]]
    moved[edge] = tiles[inner[torch.randint(len(inner), edge.shape, generator=generator)]]
    moved = moved.unflatten(0, (rows, columns)).permute(2, 0, 3, 1, 4)
    result[:, : rows * side, : columns * side] = moved.flatten(3).flatten(1, 2)
    return SrgbTexture(result)


def _painted(texture: SrgbTexture, mask: Mask | None) -> Bool[Tensor, "height width"]:
    if mask is None or not (mask > 0.5).any():
        return torch.ones(texture.shape[-2:], dtype=torch.bool)
    return mask[0] > 0.5


def _shares(painted: Bool[Tensor, "height width"], side: int) -> Float[Tensor, "rows columns"]:
    """How much of each square is paint: exactly 1 where all is."""
    return F.avg_pool2d(painted[None].double(), side)[0]


def _side(painted: Bool[Tensor, "height width"], side: int) -> int:
    """Texels per side of the squares, halved until those within the paint hold a quarter of it."""
    while side > 1 and 4 * int((_shares(painted, side) == 1).sum()) * side**2 < painted.sum():
        side //= 2
    return side
