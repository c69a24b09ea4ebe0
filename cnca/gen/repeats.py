"""Textures that repeat without seams, from a model that knows nothing of repeating.

The latents are rolled round the torus before every denoising step, by another distance each time,
and back afterwards: the borders that the model pads with zeros lie elsewhere in each step, so that
none of them stays.  The distances are those of the R2 sequence (Roberts 2018, "The unreasonable
effectiveness of quasirandom sequences"), which spreads evenly.
"""

from __future__ import annotations

import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

R2 = (0.7548776662466927, 0.5698402909980532)
"""1/ρ and 1/ρ², ρ the real root of ρ³ = ρ + 1."""
MARGIN = 4
"""Latents of the other side that the decoder sees beyond each border."""

LatentImage = Float[Tensor, "1 channels rows columns"]


def shift(step: int, latents: LatentImage) -> tuple[int, int]:
    """Rows and columns by which ``latents`` are rolled before step number ``step``."""
    rows, columns = latents.shape[-2:]
    return int(step * R2[0] % 1.0 * rows), int(step * R2[1] % 1.0 * columns)


def rolled(latents: LatentImage, by: tuple[int, int]) -> LatentImage:
    """``latents`` on the torus, moved down and to the right."""
    return latents.roll(by, dims=(-2, -1))


def rolled_back(latents: LatentImage, by: tuple[int, int]) -> LatentImage:
    """The inverse of :func:`rolled`."""
    return rolled(latents, (-by[0], -by[1]))


def wrapped(latents: LatentImage) -> Float[Tensor, "1 channels wider higher"]:
    """``latents`` with :data:`MARGIN` of the other side around them."""
    return F.pad(latents, (MARGIN,) * 4, mode="circular")


def tiled(
    decoded: Float[Tensor, "channels wider higher"], pixels: int, repeats: int
) -> Float[Tensor, "channels height width"]:
    """What :func:`wrapped` was decoded to, without its margin, ``repeats`` times per side.

    ``pixels`` are those that one latent becomes.
    """
    margin = MARGIN * pixels
    return decoded[:, margin:-margin, margin:-margin].repeat(1, repeats, repeats)
