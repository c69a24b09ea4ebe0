"""The EFR network (paper, section 3.2, after DTA): a U-Net that corrects a render.

It reads the reference X_ref and the render X_nr and gives a multiplicative and an additive map.

Two things are ours.  The paper masks the vehicle out before and adds the background after; here all
pictures show the same background: what is equal in them stays as it is, and the network works on
the part of the picture around the rest.  And it sees X_nr0, what the renderer makes of the
reference's own paint.  Light adds up: if the renderer errs by a factor 1 + M in the light that
paint scatters and leaves out all gloss, the truth is exactly X_ref + (1 + M) (X_nr − X_nr0).  So

    X_ren = X_nr + g (X_ref − X_nr0) + M (X_nr − X_nr0) + A,

g a trained number for each colour, M and A the network's maps.  All are zero before training: it
starts as the identity.
"""

from __future__ import annotations

from pathlib import Path

import torch
import torch.nn.functional as F
from jaxtyping import Bool
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from cnca.errors import CncaError
from cnca.files import replacing
from cnca.types import LinearImages, PlainPictures

WIDTHS = (16, 32, 32)
FOLD = 2
"""Pixels of a side that the network sees as channels of one: a quarter of the work."""
GROUPS = 4
"""Of channels, each normalized by itself."""
DARKEST = 1e-2
"""Added below the logarithm that turns ratios of pictures into differences."""


class EnvironmentFeatureRenderer(nn.Module):
    """Corrects linear images (batch, 3, height, width) towards their reference's look."""

    def __init__(self, widths: tuple[int, ...] = WIDTHS):
        super().__init__()
        inputs = (9 * FOLD**2, *widths[:-1])
        self.down = nn.ModuleList(_block(i, o) for i, o in zip(inputs, widths, strict=True))
        pairs = list(zip(widths[:0:-1], widths[-2::-1], strict=True))
        self.up = nn.ModuleList(_block(deep + skip, skip) for deep, skip in pairs)
        self.maps = nn.Conv2d(widths[0], 6 * FOLD**2, kernel_size=1)
        self.left_out = nn.Parameter(torch.zeros(3, 1, 1))
        for parameter in self.maps.parameters():
            nn.init.zeros_(parameter)

    def forward(self, images: LinearImages, reference: PlainPictures) -> LinearImages:
        """Return X_ren, ≥ 0; differentiable in ``images``.

        Each picture is cut to its own vehicle: the norms would mix in what else is there.
        """
        pictures = images, reference.traced, reference.drawn
        each = zip(*(picture.split(1) for picture in pictures), strict=True)
        return torch.cat([self._one(*cut) for cut in each])

    def _one(self, image: LinearImages, traced: LinearImages, drawn: LinearImages) -> LinearImages:
        """X_ren of a batch of one."""
        vehicle = (image != traced).any(dim=1, keepdim=True)
        if not vehicle.any():
            return image
        part = (..., _extent(vehicle.any(dim=3)), _extent(vehicle.any(dim=2)))
        corrected = image.clone()
        cut = image[part], traced[part], drawn[part]
        corrected[part] = torch.where(vehicle[part], self._correct(*cut).clamp(min=0), cut[0])
        return corrected

    def _correct(self, images: LinearImages, traced: LinearImages, drawn: LinearImages) -> Tensor:
        multiply, add = self._maps(images, traced, drawn).chunk(2, dim=1)
        return images + self.left_out * (traced - drawn) + multiply * (images - drawn) + add

    def _maps(self, *pictures: LinearImages) -> Tensor:
        """M and A, one after the other (batch, 6, height, width)."""
        height, width = pictures[0].shape[-2:]
        both = (torch.cat(pictures, dim=1).clamp(min=0) + DARKEST).log()
        both = F.pad(both, (0, -width % FOLD, 0, -height % FOLD), mode="replicate")
        features, skips = F.pixel_unshuffle(both, FOLD), []
        for level, block in enumerate(self.down):
            # The last row or column of an odd size is a mean of what there is.
            features = block(F.avg_pool2d(features, 2, ceil_mode=True) if level else features)
            skips.append(features)
        for block, skip in zip(self.up, skips[-2::-1], strict=True):
            wider = F.interpolate(features, size=skip.shape[-2:], mode="bilinear")
            features = block(torch.cat([wider, skip], dim=1))
        return F.pixel_shuffle(self.maps(features), FOLD)[..., :height, :width]

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


def _extent(covered: Bool[Tensor, "1 1 positions"]) -> slice:
    """The positions from the first to the last that are covered."""
    places = covered.flatten().nonzero()
    return slice(int(places[0]), int(places[-1]) + 1)


def _block(inputs: int, outputs: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for width in (inputs, outputs):
        # Without norms the paper's steps of 0.01 kill the features within an epoch.
        layers += [
            nn.Conv2d(width, outputs, kernel_size=3, padding=1),
            nn.GroupNorm(GROUPS, outputs),
            nn.SiLU(),
        ]
    return nn.Sequential(*layers)
