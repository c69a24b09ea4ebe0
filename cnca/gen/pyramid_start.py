"""Initial weights that make an autoencoder a color pyramid: it learns detail from step one.

From random weights a small autoencoder spends most of a short training on finding the colors.
Here the first six channels carry +RGB and −RGB; resnets start as identities, downsamplers as
means of 2×2 pixels.  Two facts let colors pass what is not linear: SiLU(x) − SiLU(−x) = x, and
group normalisation over all channels at once keeps relations between channels, its divisor held
steady by one constant channel.
"""

from __future__ import annotations

import torch
from diffusers import AutoencoderKL
from diffusers.models.downsampling import Downsample2D
from diffusers.models.resnet import ResnetBlock2D
from diffusers.models.upsampling import Upsample2D
from torch import nn

CONSTANT = 2.0
"""Value of the constant channel, large beside colors in [−1, 1]."""

LOG_VARIANCE = -6.0
"""Of the latents at the start: nearly deterministic, as noise would drown the colors."""


@torch.no_grad()
def start_as_pyramid(vae: AutoencoderKL) -> None:
    """Overwrite the weights that matter; all others keep their random start, scaled down."""
    for module in vae.modules():
        if isinstance(module, ResnetBlock2D):
            module.conv2.weight.mul_(0.1)
            module.conv2.get_parameter("bias").zero_()
            if module.conv_shortcut is not None:
                _pass_channels(module.conv_shortcut)
        elif isinstance(module, Upsample2D):
            _pass_channels(module.conv)
        elif isinstance(module, Downsample2D):
            _pass_channels(module.conv, taps=((0, 0), (0, 1), (1, 0), (1, 1)))
    for half in (vae.encoder, vae.decoder):
        _spread(half.conv_in)
        _gather(half.conv_out)
    for mixing in (vae.quant_conv, vae.post_quant_conv):
        mixing.weight.copy_(torch.eye(len(mixing.weight))[..., None, None])
        mixing.bias.zero_()
    vae.quant_conv.bias[vae.config.latent_channels :] = LOG_VARIANCE


def _pass_channels(conv: nn.Conv2d, taps: tuple[tuple[int, int], ...] | None = None) -> None:
    """Hand the first seven channels on unchanged (the mean of ``taps``), mix the others."""
    centre = conv.kernel_size[0] // 2
    taps = taps or ((centre, centre),)
    conv.weight[:7] = 0.0
    conv.get_parameter("bias").zero_()
    for channel in range(7):
        for row, column in taps:
            conv.weight[channel, channel, row, column] = 1.0 / len(taps)


def _spread(conv: nn.Conv2d) -> None:
    """Three inputs → channels 0–2 as they are, 3–5 negated, 6 constant."""
    conv.weight[:7] = 0.0
    bias = conv.get_parameter("bias")
    bias.zero_()
    bias[6] = CONSTANT
    for color in range(3):
        conv.weight[color, color, 1, 1] = 1.0
        conv.weight[3 + color, color, 1, 1] = -1.0


def _gather(conv: nn.Conv2d) -> None:
    """Channels 0–2 minus 3–5 → three outputs, rescaled by what normalisation divided by."""
    conv.weight.mul_(0.1)
    conv.get_parameter("bias").zero_()
    gain = 1.7 * (CONSTANT**2 / conv.in_channels) ** 0.5  # 1.7: measured
    for color in range(3):
        conv.weight[color, color, 1, 1] = gain
        conv.weight[color, 3 + color, 1, 1] = -gain
