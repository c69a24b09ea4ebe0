"""What a texture is made of beside its prompt."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from cnca.core.types import SrgbTexture
from cnca.gen.feature import Feature
from cnca.gen.noise import Noises
from cnca.scene.protocols import NoisyTextureGenerator, TextureGenerator


@dataclass(frozen=True, eq=False)
class Latents:
    """The inputs of a generator that an attack may move."""

    feature: Feature | None = None
    """F_adv; None where the model reads the prompt alone."""
    noises: Noises | None = None
    """x_T and the noise of each step of DDIM with η = 1; None: x_T of the seed alone, and η = 0."""

    def texture(self, generator: TextureGenerator, prompt: str, seed: int) -> SrgbTexture:
        """The texture of these latents, without gradient."""
        with torch.no_grad():
            return self.paint(generator, generator.encode(prompt), seed)

    def paint(
        self,
        generator: TextureGenerator,
        text_feature: torch.Tensor,
        seed: int,
        *,
        together: bool = False,
    ) -> SrgbTexture:
        """T_adv, differentiable in the latents.

        ``together``: all processes of the job call this at once, and divide the work.
        """
        rng = torch.Generator().manual_seed(seed)
        if self.noises is None:
            return generator.generate(text_feature, self.feature, rng, together=together)
        assert isinstance(generator, NoisyTextureGenerator)
        return generator.generate(
            text_feature, self.feature, rng, noises=self.noises, together=together
        )
