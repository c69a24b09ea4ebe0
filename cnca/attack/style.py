"""A style term: what a texture costs when it fits its prompt less than one without an attack."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from cnca.core.types import SrgbImages, SrgbTexture
from cnca.gen.scorer import PromptScorer

MARGIN = 0.03
"""Drop of the prompt score, a cosine, that costs nothing."""


@dataclass(frozen=True)
class Style:
    """weight · relu(s_ref − 0.03 − s), s the prompt score of the texture; differentiable."""

    scorer: PromptScorer
    prompt: str
    reference: float
    """s_ref: the prompt score of the texture without an attack."""
    weight: float

    def __call__(self, texture: SrgbTexture) -> Float[Tensor, ""]:
        """The cost of the texture, ≥ 0; 0 where it keeps its prompt score."""
        score = self.scorer.score(SrgbImages(texture[None]), [self.prompt])[0, 0]
        return self.weight * (self.reference - MARGIN - score).relu()


def style_of(scorer: PromptScorer, prompt: str, unattacked: SrgbTexture, weight: float) -> Style:
    """The style term that holds on to what ``unattacked`` has of the prompt."""
    reference = scorer.score(SrgbImages(unattacked[None]), [prompt]).item()
    return Style(scorer, prompt, reference, weight)
