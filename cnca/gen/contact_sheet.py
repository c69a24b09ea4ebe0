"""Prompts × seeds in one picture, to see what a generator paints."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from cnca.core.pictures import SrgbPicture, as_pictures, side_by_side
from cnca.core.types import SrgbImages
from cnca.scene.protocols import TextureGenerator


@torch.no_grad()
def contact_sheet(
    generator: TextureGenerator, prompts: Sequence[str], seeds: Sequence[int]
) -> SrgbPicture:
    """One column for each prompt under its caption, one row for each seed of the noise."""
    features = [generator.encode(prompt) for prompt in prompts]
    textures: list[torch.Tensor] = [
        generator.generate(feature, None, torch.Generator().manual_seed(seed))
        for seed in seeds
        for feature in features
    ]
    return side_by_side(
        as_pictures(SrgbImages(torch.stack(textures))), prompts, columns=len(prompts)
    )
