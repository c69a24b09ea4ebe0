"""The EFR network (paper, section 3.2, after DTA): a U-Net that corrects a render.

It reads the reference X_ref, which is path-traced, and X_nr0, what the renderer makes of the
reference's own paint, and gives a multiplicative and an additive map.  Light adds up: at a pixel

    X_ref = k · X_nr0 + s,        the truth of any other paint = k · X_nr + s,

k how much more light the paint scatters than the renderer believes, s what reaches the camera
without the paint's color: gloss, and fog in between.  So one pair of pictures tells the correction
of all paints, and the paper's net, which also reads X_nr, would have to unlearn it:

    X_ren = (1 + M) X_nr + A,    M = v (k̂ − 1) + m,    A = g (X_ref − X_nr0) − M X_nr0 + a.

m and a are the network's maps, v and g trained numbers for each color, all zero before training:
it starts as the identity.  k̂ is the closed form for grey gloss: the slope of X_ref over X_nr0
across a pixel's three colors (the dichromatic reflection model, Shafer 1985).  A grey paint tells
nothing of k; there a prior pulls k̂ to 1.

Also ours: the paper masks the vehicle out before and adds the background after; here all pictures
show the same background: what is equal in them stays as it is, and the network works on the part of
the picture where they differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import EllipsisType
from typing import Any
from weakref import WeakKeyDictionary

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from cnca.core.errors import CncaError
from cnca.core.files import replacing
from cnca.core.types import LinearImages, PlainPictures

WIDTHS = (16, 32, 32)
CHANNELS = 7
"""Of what the network reads: X_ref, X_nr0 and k̂."""
FOLD = 2
"""Pixels of a side that the network sees as channels of one: a quarter of the work."""
GROUPS = 4
"""Of channels, each normalized by itself."""
DARKEST = 1e-2
"""Added below the logarithm that turns ratios of pictures into differences."""
PRIOR = 1e-3
"""Weight of k̂ = 1 beside a pixel's colors: their variance where both count alike."""


@dataclass(frozen=True)
class Correction:
    """X_ren = gain · X_nr + offset in the part of one view that holds the vehicle."""

    part: tuple[EllipsisType, slice, slice]
    """Rows and columns; elsewhere nothing is corrected."""
    gain: Float[Tensor, "batch 3 height width"]
    offset: LinearImages

    def __call__(self, images: LinearImages) -> LinearImages:
        """X_ren, ≥ 0, of one image or several in this view; differentiable in the maps, too."""
        corrected = images.clone()
        corrected[self.part] = torch.addcmul(self.offset, self.gain, images[self.part]).clamp(min=0)
        return LinearImages(corrected)


class _Corrected(torch.autograd.Function):
    """Images, each with its own correction, whose maps are fixed.

    Autograd itself would copy whole pictures several times for the part that changes.
    """

    @staticmethod
    def forward(ctx: Any, images: Tensor, corrections: Sequence[Correction]) -> Tensor:
        corrected, ctx.slopes = images.clone(), []
        pictures = zip(corrected.split(1), images.split(1), corrections, strict=True)
        for picture, image, correction in pictures:
            part = torch.addcmul(correction.offset, correction.gain, image[correction.part])
            picture[correction.part] = part.clamp(min=0)
            ctx.slopes.append((correction.part, correction.gain * (part >= 0)))
        return corrected

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        gradient = gradients[0].clone()
        for picture, (part, slope) in zip(gradient.split(1), ctx.slopes, strict=True):
            picture[part] *= slope
        return gradient, None


class EnvironmentFeatureRenderer(nn.Module):
    """Corrects linear images (batch, 3, height, width) towards their reference's look."""

    def __init__(self, widths: tuple[int, ...] = WIDTHS) -> None:
        super().__init__()
        inputs = (CHANNELS * FOLD**2, *widths[:-1])
        self.down = nn.ModuleList(_block(i, o) for i, o in zip(inputs, widths, strict=True))
        pairs = list(zip(widths[:0:-1], widths[-2::-1], strict=True))
        self.up = nn.ModuleList(_block(deep + skip, skip) for deep, skip in pairs)
        self.maps = nn.Conv2d(widths[0], 6 * FOLD**2, kernel_size=1)
        self.left_out = nn.Parameter(torch.zeros(3, 1, 1))  # g
        self.slope = nn.Parameter(torch.zeros(3, 1, 1))  # v
        for parameter in self.maps.parameters():
            nn.init.zeros_(parameter)
        self._kept: WeakKeyDictionary[PlainPictures, Correction] = WeakKeyDictionary()

    def forward(self, images: LinearImages, references: Sequence[PlainPictures]) -> LinearImages:
        """Return X_ren, ≥ 0, of each image with its reference; differentiable in ``images``.

        Once trained, a reference's correction is kept as long as the reference itself is.
        """
        corrections = [self.correction(reference) for reference in references]
        if not self.training:
            return _Corrected.apply(images, corrections)
        pairs = zip(images.split(1), corrections, strict=True)
        return LinearImages(torch.cat([correction(image) for image, correction in pairs]))

    def train(self, mode: bool = True) -> EnvironmentFeatureRenderer:
        """Begin or end training; what is kept would not know of other weights."""
        self._kept.clear()
        super().train(mode)
        return self

    def correction(self, reference: PlainPictures) -> Correction:
        """What turns this view's renders into X_ren, in whichever paint."""
        if self.training:
            return self._correction(reference.traced, reference.drawn)
        if reference not in self._kept:
            with torch.no_grad():
                correction = self._correction(reference.traced, reference.drawn)
            self._kept[reference] = correction
        return self._kept[reference]

    def _correction(self, traced: LinearImages, drawn: LinearImages) -> Correction:
        vehicle = (traced != drawn).any(dim=1, keepdim=True)
        part = (..., _extent(vehicle.any(dim=3)), _extent(vehicle.any(dim=2)))
        vehicle = vehicle[part]
        traced, drawn = (LinearImages(image[part]) for image in (traced, drawn))
        if not vehicle.any():
            return Correction(part, traced, drawn)
        k_hat = paint_slope(traced, drawn)
        multiply, add = self._maps(traced, drawn, k_hat).chunk(2, dim=1)
        multiply = self.slope * (k_hat - 1) + multiply
        add = self.left_out * (traced - drawn) - multiply * drawn + add
        return Correction(
            part,
            torch.where(vehicle, 1 + multiply, 1),
            LinearImages(torch.where(vehicle, add, 0)),
        )

    def _maps(self, *pictures: Tensor) -> Float[Tensor, "1 6 height width"]:
        """The network's m and a, one after the other."""
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


def paint_slope(traced: LinearImages, drawn: LinearImages) -> Float[Tensor, "batch 1 height width"]:
    """k̂: the regression of X_ref on X_nr0 over a pixel's colors, 1 where these are all alike."""
    off_traced, off_drawn = (p - p.mean(dim=1, keepdim=True) for p in (traced, drawn))
    together = (off_traced * off_drawn).mean(dim=1, keepdim=True)
    alone = off_drawn.square().mean(dim=1, keepdim=True)
    return (together + PRIOR) / (alone + PRIOR)


def weighted_bce(corrected: Tensor, truth: Tensor, mask: Tensor) -> Tensor:
    """L_EFR = W(X_ref) · BCE(X_ren, GT) with W = H · W / S (paper, equation 10).

    Args:
        corrected: X_ren, display values in [0, 1], (batch, 3, height, width).
        truth: GT, of the same shape and range.
        mask: (batch, 1, height, width); S is its sum, the number of pixels of the vehicle.
            Without any, the weight would be infinite: such an image counts as if it had one pixel.
    """
    weight = mask[0, 0].numel() / mask.sum(dim=(1, 2, 3)).clamp(min=1)
    bce = F.binary_cross_entropy(corrected, truth, reduction="none").mean(dim=(1, 2, 3))
    return (weight * bce).mean()


def _extent(covered: Bool[Tensor, "1 1 positions"]) -> slice:
    """The positions from the first to the last that are covered; none where none is."""
    places = covered.flatten().nonzero()
    return slice(int(places[0]), int(places[-1]) + 1) if len(places) else slice(0)


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
