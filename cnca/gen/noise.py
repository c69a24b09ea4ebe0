"""The noises of stochastic DDIM: x_T and one for each step, as variables of an attack.

With η = 1 (Song et al. 2021, equation 16) each step of DDIM adds fresh noise.  Optimizing these
noises in place of what the model reads is direct noise optimization (Tang et al., ICML 2025; x_T
alone: ReNO, Eyring et al., NeurIPS 2024): the denoiser draws every texture that it is given noise
for in the style of the prompt, as long as the noise is such as it was trained on.  Two things keep
it so: each channel is standardised at each use, and :func:`low_frequency_excess` is a penalty.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

if TYPE_CHECKING:
    from diffusers import DDIMScheduler
    from diffusers.schedulers.scheduling_ddim import DDIMSchedulerOutput

Noises = Float[Tensor, "draws channels rows columns"]
"""x_T first, then the noise of each step in the order of sampling."""

POOLS = (2, 4, 8)
"""Sides of the blocks whose means are compared with those of white noise."""


def draw(shape: tuple[int, int, int, int], rng: torch.Generator) -> Noises:
    """White noise of this shape, drawn one after the other as diffusers' pipelines draw it."""
    draws, *one = shape
    return torch.stack([torch.randn(one, generator=rng, device=rng.device) for _ in range(draws)])


def standardized(noises: Noises) -> Noises:
    """Each channel of each draw shifted and scaled to mean 0 and variance 1.

    A channel without any variation becomes 0.
    """
    centered = noises - noises.mean(dim=(-2, -1), keepdim=True)
    variance = centered.square().mean(dim=(-2, -1), keepdim=True)
    return centered * variance.clamp(min=1e-12).rsqrt()


def low_frequency_excess(noises: Noises) -> Float[Tensor, ""]:
    """Σ over k = 2, 4, 8 of relu(k² · mean(avgpool_k(z)²) − 1), averaged over the draws; ≥ 0.

    The mean of k² independent values of variance 1 has the variance 1/k²: white noise gives 0, up
    to its own fluctuation.  A larger value says that neighbors are alike, as they are in no noise
    that the denoiser was trained on.
    Blocks larger than the latents are left out.
    """
    white = standardized(noises)
    excesses = [
        F.relu(k**2 * F.avg_pool2d(white, k).square().mean(dim=(1, 2, 3)) - 1.0)
        for k in POOLS
        if k <= min(white.shape[-2:])
    ]
    return torch.stack(excesses).sum(dim=0).mean() if excesses else noises.new_zeros(())


def noisy_step(
    scheduler: DDIMScheduler, t: int, moved: DDIMSchedulerOutput, noise: Tensor
) -> Tensor:
    """x_{t−1} for η = 1, from the deterministic step ``moved`` from x_t: x_0 and √(1 − ᾱ′) ε.

    With ᾱ and ᾱ′ the signal left at t and at t − 1, σ² = r (1 − ᾱ′), r = (1 − ᾱ/ᾱ′) / (1 − ᾱ), and
    equation 12 reads √ᾱ′ x_0 + √(1 − r) √(1 − ᾱ′) ε + σ z.  diffusers takes the root of
    1 − ᾱ′ − σ², which where no signal is left (ᾱ = 0, r = 1) is 0 but for rounding: it gives NaN.
    """
    before = t - scheduler.config.num_train_timesteps // scheduler.num_inference_steps
    left = float(scheduler.alphas_cumprod[t])
    then = float(scheduler.alphas_cumprod[before] if before >= 0 else scheduler.final_alpha_cumprod)
    ratio = (1.0 - left / then) / (1.0 - left)
    clean = then**0.5 * moved.pred_original_sample
    return (
        clean
        + (1.0 - ratio) ** 0.5 * (moved.prev_sample - clean)
        + (ratio * (1.0 - then)) ** 0.5 * noise
    )
