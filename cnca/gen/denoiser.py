"""Training of the U-Net on text, and on the tokens that F_adv takes at attack time.

Those tokens are trained as *image prompt* tokens (after the idea of IP-Adapter, Ye et al. 2023):
token k describes the k-th cell of the picture, in half of the samples not at all.  So the U-Net
listens to them, values in [−1, 1] are in its range, and zero means "no wish".  They are added to
the features of the empty prompt, which differ by position and so tell the cells apart; and the
U-Net normalises each token before it pools them, which around zero would make the smallest F_adv
as strong as the largest.
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

GRID = (7, 11)
"""Rows and columns of the cells that F_adv's tokens describe: 77, one for each token of a text."""

WISH_DEVIATION = 0.5
"""Standard deviation of an element of F_adv that describes an ordinary picture."""

SILENT = 0.5
"""Share of samples whose F_adv says nothing, so that the text is listened to."""

BLIND = 0.1
"""Share of samples without text or F_adv, for classifier-free guidance (Ho & Salimans 2022)."""


class ImagePrompt(nn.Module):
    """Describes latents by one token per cell: a fixed rotation of its four quarters' means.

    Fixed, so that the length of F_adv keeps its meaning: a trained one could learn to shout.
    Needed in training only.
    """

    rotation: Tensor

    def __init__(self) -> None:
        super().__init__()
        values = 4 * 2 * 2
        orthonormal = nn.init.orthogonal_(torch.empty(values, architecture.TEXT_WIDTH))
        scale = WISH_DEVIATION * (architecture.TEXT_WIDTH / values) ** 0.5
        self.register_buffer("rotation", scale * orthonormal)

    def forward(
        self, latents: Float[Tensor, "batch 4 height width"], generator: torch.Generator
    ) -> Float[Tensor, "batch 77 width"]:
        """Return tokens in [−1, 1]; of half of the batch all zero, of the others a random share."""
        rows, columns = GRID
        quarters = F.adaptive_avg_pool2d(latents, (2 * rows, 2 * columns))
        cells = F.unfold(quarters, kernel_size=2, stride=2).transpose(1, 2)
        tokens = (cells @ self.rotation).clamp(-1.0, 1.0)
        silent = torch.rand(len(latents), 1, 1, generator=generator) < SILENT
        share = torch.rand(len(latents), 1, 1, generator=generator)
        dropped = torch.rand(*tokens.shape[:2], 1, generator=generator) < share
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
        extra = self.nothing + wish
        alone = torch.rand((), generator=generator) < 0.1  # without F_adv there are 77 tokens
        condition = text if alone else torch.cat([extra, text], dim=1)
        times = torch.randint(len(self.schedule.betas), (batch,), generator=generator)
        where = architecture.positions(clean.shape[-1]).expand(batch, -1, -1, -1)
        clean = torch.cat([clean, where], dim=1)
        noise = torch.randn(clean.shape, generator=generator)
        noisy = self.schedule.add_noise(clean, noise, times)
        velocity = self.schedule.get_velocity(clean, noise, times)
        with torch.autocast("cpu", torch.bfloat16):
            predicted = self.unet(noisy, times, condition).sample
        return F.mse_loss(predicted.float(), velocity)


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
