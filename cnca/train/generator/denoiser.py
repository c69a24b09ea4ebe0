"""Training of the U-Net on text, and on the tokens that F_adv takes at attack time.

Those tokens are trained as *image prompt* tokens (after the idea of IP-Adapter, Ye et al. 2023):
token k describes the k-th cell of the picture.  So the U-Net listens to them, values in [−1, 1] are
in its range, and zero means "no wish".  They are added to the features of the empty prompt, which
differ by position and so tell the cells apart; and the U-Net normalizes each token before it pools
them, which around zero would make the smallest F_adv as strong as the largest.

They come first and alone: beside a text, which says more at a glance, the U-Net never learned
to look them up.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn
from transformers import CLIPTextModel, CLIPTokenizer

from cnca.gen import architecture
from cnca.train.loop import TrainingLoop
from cnca.train.task import Recipe, Task

GRID = (7, 11)
"""Rows and columns of the cells that F_adv's tokens describe: 77, one for each token of a text."""

WISH_DEVIATION = 0.5
"""Standard deviation of an element of F_adv that describes an ordinary picture."""

SILENT = 0.4
"""Share of samples with a text whose F_adv says nothing, so that the text is listened to."""

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
        self, latents: Float[Tensor, "batch 4 rows columns"]
    ) -> Float[Tensor, "batch 77 width"]:
        """Return tokens in [−1, 1]."""
        rows, columns = GRID
        quarters = F.adaptive_avg_pool2d(latents, (2 * rows, 2 * columns))
        cells = F.unfold(quarters, kernel_size=2, stride=2).transpose(1, 2)
        return (cells @ self.rotation).clamp(-1.0, 1.0)


class Denoiser(nn.Module):
    """All that the second stage trains, with its error: v-prediction (Salimans & Ho 2022)."""

    nothing: Tensor

    def __init__(self, nothing: Float[Tensor, "77 width"]) -> None:
        """``nothing`` is the feature of the empty prompt."""
        super().__init__()
        self.unet = architecture.denoiser()
        self.image_prompt = ImagePrompt()
        self.schedule = architecture.scheduler()
        self.register_buffer("nothing", nothing)

    def velocity_error(
        self,
        clean: Float[Tensor, "batch 4 rows columns"],
        text: Float[Tensor, "batch 77 width"] | None,
        rng: torch.Generator,
    ) -> Tensor:
        """Mean squared error of the velocity at random times; without ``text``, of F_adv alone."""
        batch = len(clean)
        extra = self.nothing + self.image_prompt(clean)
        condition = extra if text is None else self._joined(extra, text, rng)
        times = torch.randint(len(self.schedule.betas), (batch,), generator=rng)
        where = architecture.positions(clean.shape[-1]).expand(batch, -1, -1, -1)
        clean = torch.cat([clean, where], dim=1)
        noise = torch.randn(clean.shape, generator=rng)
        noisy = self.schedule.add_noise(clean, noise, times)
        velocity = self.schedule.get_velocity(clean, noise, times)
        with torch.autocast("cpu", torch.bfloat16):
            predicted = self.unet(noisy, times, condition).sample
        return F.mse_loss(predicted.float(), velocity)

    def _joined(self, extra: Tensor, text: Tensor, rng: torch.Generator) -> Tensor:
        """F_adv's tokens and the text's, each left out in its share of the samples."""
        blind = torch.rand(len(text), 1, 1, generator=rng) < BLIND
        silent = torch.rand(len(text), 1, 1, generator=rng) < SILENT
        extra = torch.where(blind | silent, self.nothing, extra)
        text = torch.where(blind, self.nothing, text)
        alone = torch.rand((), generator=rng) < 0.1  # without F_adv there are 77 tokens
        return text if alone else torch.cat([extra, text], dim=1)


@torch.no_grad()
def text_features(
    captions: Sequence[str], tokenizer: CLIPTokenizer, encoder: CLIPTextModel
) -> Float[Tensor, "captions 77 width"]:
    """F_txt of each caption."""
    words = tokenizer(list(captions), padding="max_length", return_tensors="pt").input_ids
    return torch.cat([encoder(chunk).last_hidden_state for chunk in words.split(64)])


class DenoiserTask(Task[tuple[Tensor, Tensor | None]]):
    """One stage of the U-Net's training: latents of one size, with or without their captions."""

    network: Denoiser

    def __init__(
        self,
        denoiser: Denoiser,
        latents: Float[Tensor, "pictures 4 32 32"],
        text: Float[Tensor, "pictures 77 width"] | None,
        *,
        side: int,
        steps: int,
        batch: int,
    ) -> None:
        """``side`` is that of the crops of ``latents``; without ``text``, F_adv stands alone."""
        self.name = f"denoiser-{side}" if text is not None else f"denoiser-wish-{side}"
        self.network = denoiser
        self.recipe = Recipe(steps, 1.5e-3)
        self.settings = {"batch": batch}
        self._latents, self._text, self._side, self._batch = latents, text, side, batch

    def batch(self, step: int, rng: torch.Generator) -> tuple[Tensor, Tensor | None]:
        """Latents cut out at one place, and the features of their captions."""
        side, whole = self._side, self._latents.shape[-1]
        chosen = torch.randint(len(self._latents), (self._batch,), generator=rng)
        top, left = torch.randint(whole + 1 - side, (2,), generator=rng).tolist()
        clean = self._latents[chosen, :, top : top + side, left : left + side]
        return clean, None if self._text is None else self._text[chosen]

    def losses(
        self, batch: tuple[Tensor, Tensor | None], rng: torch.Generator
    ) -> dict[str, Tensor]:
        """The velocity's error."""
        return {"velocity": self.network.velocity_error(*batch, rng)}


def train_denoiser(
    loop: TrainingLoop,
    denoiser: Denoiser,
    latents: Float[Tensor, "pictures 4 32 32"],
    text: Float[Tensor, "pictures 77 width"],
    *,
    steps: tuple[int, int, int, int],
    batch: int,
) -> Denoiser:
    """Learn to follow F_adv, then words beside it: on quarter pictures, then on whole ones.

    A step on quarter pictures takes half the time and sees twice as many.
    """
    stages = ((16, None), (16, text), (32, None), (32, text))
    for (side, words), count in zip(stages, steps, strict=True):
        task = DenoiserTask(
            denoiser, latents, words, side=side, steps=count, batch=batch * 32 // side
        )
        denoiser.load_state_dict(loop.run(task).state_dict())
    return denoiser
