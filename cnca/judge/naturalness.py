"""How natural a camouflage is, as numbers in place of the paper's survey."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from scipy.interpolate import RegularGridInterpolator
from torch import Tensor

from cnca.core.errors import RunError
from cnca.core.images import read_texture_srgb
from cnca.core.types import SrgbTexture
from cnca.gen.scorer import PromptScorer
from cnca.judge.style import windows

COLOR_SIDE = 32
"""Texels per side, after averaging, whose colors are looked at."""

LIGHTNESS = (15.0, 90.0)
"""L* between which Pointer's gamut is given."""


@dataclass(frozen=True)
class Naturalness:
    """Numbers of one texture; by the first it follows the prompt, by the others it looks sane."""

    prompt_score: float
    """Cosine of picture and prompt in [−1, 1], by a CLIP-like scorer; mean over windows of 256²."""
    distance: float
    """Root mean square difference of display values from the picture with F_adv = 0, in [0, 1]."""
    total_variation: float
    """Mean absolute difference of neighbouring texels' display values, both ways, in [0, 2]."""
    real_colours: float
    """Share of the texels as colorful as real surfaces can be: inside the gamut of Pointer 1980,
    made of 4089 samples of paints, inks, textiles and natural surfaces.  Lightness beyond its 15 to
    90 counts as 15 or 90: black and white paints are natural."""
    chroma: float
    """Mean CIE 1976 chroma C*ab under D65; 0 is grey."""


def naturalness(
    texture: SrgbTexture, unattacked: SrgbTexture, prompt: str, scorer: PromptScorer
) -> Naturalness:
    """Measure ``texture`` beside the one that the prompt alone gives.

    Raises :class:`GeneratorError` where the scorer cannot read the prompt.
    """
    real, chroma = _colors(texture)
    return Naturalness(
        prompt_score=scorer.score(windows(texture), [prompt]).mean().item(),
        distance=(texture - unattacked).square().mean().sqrt().item(),
        total_variation=total_variation(texture),
        real_colours=real,
        chroma=chroma,
    )


def of_run(folder: Path, prompt: str, scorer: PromptScorer) -> Naturalness:
    """Measure the camouflage in the folder of a finished run."""
    textures = []
    for name in ("texture.png", "texture_prompt.png"):
        if not (folder / name).exists():
            raise RunError(f"{folder}: no {name}; finish the run first")
        textures.append(torch.from_numpy(read_texture_srgb(folder / name)).permute(2, 0, 1))
    return naturalness(SrgbTexture(textures[0]), SrgbTexture(textures[1]), prompt, scorer)


def total_variation(texture: SrgbTexture) -> float:
    """Mean absolute difference of neighbours, along rows plus along columns (Rudin et al. 1992)."""
    return sum(texture.diff(dim=d).abs().mean().item() for d in (-2, -1))


def _colors(texture: SrgbTexture) -> tuple[float, float]:
    """Share of colors inside Pointer's gamut, and mean chroma."""
    import colour  # slow to import

    small: Tensor = F.adaptive_avg_pool2d(texture, COLOR_SIDE)
    lab = colour.XYZ_to_Lab(colour.sRGB_to_XYZ(small.flatten(1).T.double().numpy()))
    chroma = np.hypot(lab[:, 1], lab[:, 2])
    hue = np.degrees(np.arctan2(lab[:, 2], lab[:, 1])) % 360
    # Rows of lightness, chroma and hue: 16 lightnesses with 36 hues each.
    table = np.asarray(colour.models.DATA_POINTER_GAMUT_VOLUME, float).reshape(16, 36, 3)
    most = RegularGridInterpolator(
        (table[:, 0, 0], np.append(table[0, :, 2], 360)),
        np.concatenate([table[..., 1], table[:, :1, 1]], axis=1),
    )
    within = chroma <= most(np.stack([lab[:, 0].clip(*LIGHTNESS), hue], axis=1))
    return float(within.mean()), float(chroma.mean())
