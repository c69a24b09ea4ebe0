"""The one place where linear RGB and sRGB meet (IEC 61966-2-1)."""

from __future__ import annotations

from typing import overload

import torch
from torch import Tensor

from cnca.core.types import LinearImages, LinearTexture, SrgbImages, SrgbTexture


@overload
def srgb_to_linear(srgb: SrgbImages) -> LinearImages: ...
@overload
def srgb_to_linear(srgb: SrgbTexture) -> LinearTexture: ...
def srgb_to_linear(srgb: Tensor) -> Tensor:
    """Decode display values in [0, 1] to linear ones in [0, 1]; differentiable."""
    return decode(srgb)


@overload
def linear_to_srgb(linear: LinearImages) -> SrgbImages: ...
@overload
def linear_to_srgb(linear: LinearTexture) -> SrgbTexture: ...
def linear_to_srgb(linear: Tensor) -> Tensor:
    """Encode linear values for display; values outside [0, 1] are clipped, gradient 0 there."""
    return encode(linear)


def decode(srgb: Tensor) -> Tensor:
    """The curve of :func:`srgb_to_linear` for single colors and other shapes."""
    # The unused branch of `where` must have a finite gradient too, hence the clamp inside pow.
    curve = ((srgb.clamp(min=0.04045) + 0.055) / 1.055) ** 2.4
    return torch.where(srgb <= 0.04045, srgb / 12.92, curve)


def encode(linear: Tensor) -> Tensor:
    """The curve of :func:`linear_to_srgb` for single colors and other shapes."""
    inside = linear.clamp(0.0, 1.0)
    curve = 1.055 * inside.clamp(min=0.0031308) ** (1 / 2.4) - 0.055
    return torch.where(inside <= 0.0031308, inside * 12.92, curve)
