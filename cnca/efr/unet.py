"""The EFR network (paper, section 3.2, after DTA): a U-Net that corrects a render.

It reads the reference X_ref and the render X_nr and gives a multiplicative and an additive map,
X_ren = X_nr · (1 + M) + A.  Both maps are zero before training, so it starts as the identity.
"""

from __future__ import annotations

from pathlib import Path

import torch
import torch.nn.functional as F
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from cnca.errors import CncaError
from cnca.files import replacing
from cnca.types import LinearImages

WIDTHS = (16, 32, 64)


class EnvironmentFeatureRenderer(nn.Module):
    """Corrects linear images (batch, 3, height, width) towards their reference's look."""

    def __init__(self, widths: tuple[int, ...] = WIDTHS):
        super().__init__()
        inputs = (6, *widths[:-1])
        self.down = nn.ModuleList(_block(i, o) for i, o in zip(inputs, widths, strict=True))
        pairs = list(zip(widths[:0:-1], widths[-2::-1], strict=True))
        self.up = nn.ModuleList(_block(deep + skip, skip) for deep, skip in pairs)
        self.maps = nn.Conv2d(widths[0], 6, kernel_size=1)
        for parameter in self.maps.parameters():
            nn.init.zeros_(parameter)

    def forward(self, images: LinearImages, reference: LinearImages) -> LinearImages:
        """Return X_ren, ≥ 0; differentiable in both inputs."""
        features, skips = torch.cat([images, reference], dim=1), []
        for level, block in enumerate(self.down):
            features = block(F.avg_pool2d(features, 2) if level else features)
            skips.append(features)
        for block, skip in zip(self.up, skips[-2::-1], strict=True):
            wider = F.interpolate(features, size=skip.shape[-2:], mode="bilinear")
            features = block(torch.cat([wider, skip], dim=1))
        multiply, add = self.maps(features).chunk(2, dim=1)
        return (images * (1 + multiply) + add).clamp(min=0)

    def save(self, path: Path) -> None:
        """Write the weights as safetensors, whole or not at all."""
        with replacing(path) as temporary:
            save_file(self.state_dict(), temporary)

    @classmethod
    def load(cls, path: Path) -> EnvironmentFeatureRenderer:
        """Read what :meth:`save` wrote; raises CncaError for any other file."""
        network = cls()
        try:
            network.load_state_dict(load_file(path))
        except (OSError, SafetensorError, RuntimeError) as error:
            reason = str(error).splitlines()[0]
            raise CncaError(f"{path}: no EFR weights ({reason}); train them first") from None
        return network.eval().requires_grad_(False)


def weighted_bce(corrected: Tensor, truth: Tensor, mask: Tensor) -> Tensor:
    """L_EFR = W(X_ref) · BCE(X_ren, GT) with W = H · W / S (paper, equation 10).

    Args:
        corrected: X_ren, display values in [0, 1], (batch, 3, height, width).
        truth: GT, of the same shape and range.
        mask: (batch, 1, height, width); S is its sum, the number of pixels of the vehicle.
            Without any the weight would be endless: such an image counts as if it had one pixel.
    """
    weight = mask[0, 0].numel() / mask.sum(dim=(1, 2, 3)).clamp(min=1)
    bce = F.binary_cross_entropy(corrected, truth, reduction="none").mean(dim=(1, 2, 3))
    return (weight * bce).mean()


def _block(inputs: int, outputs: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for width in (inputs, outputs):
        layers += [nn.Conv2d(width, outputs, kernel_size=3, padding=1), nn.SiLU()]
    return nn.Sequential(*layers)
