"""What a texture must be before it is rendered."""

from __future__ import annotations

import torch

from cnca.core.errors import TextureError

ROUNDING = 1e-4
"""By how much an albedo may leave [0, 1]; less than the floor that keeps it positive."""


def refuse_bad_texture(albedo: torch.Tensor, size: int) -> None:
    """Raise TextureError for another shape than (3, size, size), NaN, or values off [0, 1]."""
    if tuple(albedo.shape) != (3, size, size):
        raise TextureError(
            f"texture of shape {tuple(albedo.shape)}: the renderer takes (3, {size}, {size})"
        )
    low, high = (float(bound) for bound in torch.aminmax(albedo))  # NaN if any texel is
    if not (low >= -ROUNDING and high <= 1 + ROUNDING):
        raise TextureError(f"texture has values from {low:g} to {high:g}: albedo lies in [0, 1]")
