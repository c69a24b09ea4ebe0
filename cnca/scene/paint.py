"""What of the vehicle's texture is paint: the camouflage goes there and nowhere else."""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from cnca.core.color import srgb_to_linear
from cnca.core.types import LinearTexture, SrgbTexture


@dataclass(frozen=True)
class Paint:
    """The vehicle's own texture and where it may be painted over; all of one square size."""

    base: SrgbTexture
    """The texture before any camouflage, in [0, 1]."""
    mask: Float[Tensor, "1 size size"]
    """1 where there is paint, 0 elsewhere (glass, wheels, lights)."""

    def apply(self, texture: SrgbTexture | None = None) -> LinearTexture:
        """The linear albedo to render: ``texture`` where there is paint, else the base.

        ``texture`` is (3, height, width) in [0, 1], of any size, and is resized by bilinear
        interpolation (area-averaged when it shrinks); differentiable.  None leaves the plain paint.
        """
        if texture is None:
            return srgb_to_linear(self.base)
        return srgb_to_linear(SrgbTexture(torch.lerp(self.base, self.resize(texture), self.mask)))

    def resize(self, texture: SrgbTexture) -> SrgbTexture:
        """``texture`` at the size of the base, as :meth:`apply` takes it."""
        size = self.base.shape[-2:]
        return SrgbTexture(
            F.interpolate(
                texture[None], size=size, mode="bilinear", align_corners=False, antialias=True
            )[0].clamp(0, 1)
        )
