"""Training of the U-Net on text, and on the tokens that F_adv takes at attack time.

Those tokens are trained as *image prompt* tokens (after the idea of IP-Adapter, Ye et al. 2023):
in half of the samples they describe the picture coarsely, in the other half they are zero.  So
the U-Net listens to them, values in [−1, 1] are in its range, and zero means "no wish".  They are
added to padding tokens of the empty prompt: the U-Net normalises each token before it pools them,
and around zero that would make the smallest F_adv as strong as the largest.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn
from transformers import CLIPTextModel, CLIPTokenizer

from cnca.gen import architecture
from cnca.gen.training_loop import TrainingLoop

FEATURE_TOKENS = 8
"""Tokens of F_adv that the generator is trained with."""

BLIND = 0.1
"""Share of samples without text or F_adv, for classifier-free guidance (Ho & Salimans 2022)."""


class ImagePrompt(nn.Module):
    """Describes latents by as many tokens as F_adv has: token k speaks of the k-th eighth.

    Needed in training only.
    """

    def __init__(self, tokens: int = FEATURE_TOKENS) -> None:
        super().__init__()
        self.tokens = tokens
        self.project = nn.Parameter(torch.randn(tokens, 4 * tokens, architecture.TEXT_WIDTH))

    def forward(
        self, latents: Float[Tensor, "batch 4 height width"], generator: torch.Generator
    ) -> Float[Tensor, "batch tokens width"]:
        """Return tokens in [−1, 1]; all zero for half of the batch, a quarter of the others."""
        coarse = F.adaptive_avg_pool2d(latents, self.tokens).permute(0, 2, 1, 3).flatten(2)
        scale = (4 * self.tokens) ** -0.5
        tokens = torch.tanh(scale * torch.einsum("bkc,kcw->bkw", coarse, self.project))
        silent = torch.rand(len(latents), 1, 1, generator=generator) < 0.5
        dropped = torch.rand(len(latents), self.tokens, 1, generator=generator) < 0.25
        return tokens.masked_fill(silent | dropped, 0.0)


class Denoiser(nn.Module):
    """All that the second stage trains, with its loss: v-prediction (Salimans & Ho 2022)."""

    nothing: Tensor

    def __init__(self, nothing: Float[Tensor, "77 width"]) -> None:
        """``nothing`` is the feature of the empty prompt."""
        super().__init__()
        self.unet = architecture.denoiser()
        self.image_prompt = ImagePrompt()
        self.schedule = architecture.scheduler()
        self.register_buffer("nothing", nothing)

    def loss(
        self,
        clean: Float[Tensor, "batch 4 height width"],
        text: Float[Tensor, "batch 77 width"],
        generator: torch.Generator,
    ) -> Tensor:
        """Mean squared error of the velocity at random times."""
        batch = len(clean)
        blind = torch.rand(batch, 1, 1, generator=generator) < BLIND
        text = torch.where(blind, self.nothing, text)
        wish = self.image_prompt(clean, generator).masked_fill(blind, 0.0)
        extra = self.nothing[-wish.shape[1] :] + wish
        alone = torch.rand((), generator=generator) < 0.1  # without F_adv there are 77 tokens
        condition = text if alone else torch.cat([extra, text], dim=1)
        times = torch.randint(len(self.schedule.betas), (batch,), generator=generator)
        noise = torch.randn(clean.shape, generator=generator)
        noisy = self.schedule.add_noise(clean, noise, times)
        velocity = self.schedule.get_velocity(clean, noise, times)
        return F.mse_loss(self.unet(noisy, times, condition).sample, velocity)


@torch.no_grad()
def text_features(
    captions: Sequence[str], tokenizer: CLIPTokenizer, encoder: CLIPTextModel
) -> Float[Tensor, "captions 77 width"]:
    """F_txt of each caption."""
    words = tokenizer(list(captions), padding="max_length", return_tensors="pt").input_ids
    return torch.cat([encoder(chunk).last_hidden_state for chunk in words.split(64)])


def train_denoiser(
    loop: TrainingLoop,
    denoiser: Denoiser,
    latents: Float[Tensor, "pictures 4 32 32"],
    text: Float[Tensor, "pictures 77 width"],
    *,
    steps: tuple[int, int],
    batch: int,
) -> Denoiser:
    """Learn words and patterns on quarter pictures, four times as fast, then on whole ones."""
    for side, count in zip((16, 32), steps, strict=True):
        size = batch * 32 // side

        def loss(generator: torch.Generator, side: int = side, size: int = size) -> Tensor:
            chosen = torch.randint(len(latents), (size,), generator=generator)
            top, left = torch.randint(33 - side, (2,), generator=generator).tolist()
            clean = latents[chosen, :, top : top + side, left : left + side]
            return denoiser.loss(clean, text[chosen], generator)

        averaged = loop.run(
            f"denoiser-{side}", denoiser, loss, steps=count, learning_rate=1.5e-3, average=0.99
        )
        denoiser.load_state_dict(averaged.state_dict())
    return denoiser
