"""Small shifts and scalings of the pictures in the loop, so that no pattern leans on its pixels.

A camouflage that only works where the detector's cells happen to lie on the picture's pixels works
nowhere else (expectation over transformation, Athalye et al. 2018).
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence

import torch
import torch.nn.functional as F

from cnca.core.types import Boxes, SrgbImages
from cnca.scene.cameras import View

SHIFT, SCALE = 0.05, 0.1
"""The most that a picture is shifted, as a share of its side (16 of 320 pixels), or scaled."""


def jittered(
    pictures: SrgbImages, boxes: Boxes, views: Sequence[View], seed: int
) -> tuple[SrgbImages, Boxes]:
    """Each picture scaled by 0.9 to 1.1 about its middle and shifted, its box with it.

    What comes in from outside repeats the border.  Seeded by ``seed`` and the view alone, not by
    the pictures beside it: processes that divide the views draw the same.
    """
    draws = [torch.rand(3, generator=_rng(view, seed)) * 2 - 1 for view in views]
    drawn = torch.stack(draws).to(pictures)
    scale, shift = torch.exp(drawn[:, 0] * math.log1p(SCALE)), 2 * SHIFT * drawn[:, 1:]
    theta = pictures.new_zeros(len(pictures), 2, 3)  # from places in the new picture to the old
    theta[:, 0, 0] = theta[:, 1, 1] = 1 / scale
    theta[:, :, 2] = -shift / scale[:, None]
    grid = F.affine_grid(theta, list(pictures.shape), align_corners=False)
    moved = F.grid_sample(pictures, grid, padding_mode="border", align_corners=False)
    height, width = pictures.shape[-2:]
    half = boxes.new_tensor([width, height, width, height]) / 2
    centered = boxes / half - 1
    placed = (centered * scale[:, None] + shift.repeat(1, 2) + 1) * half
    return SrgbImages(moved), torch.minimum(placed.clamp(min=0), 2 * half)


def _rng(view: View, seed: int) -> torch.Generator:
    return torch.Generator().manual_seed(zlib.crc32(f"{seed} {view!r}".encode()))
