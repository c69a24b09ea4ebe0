"""Peak memory of Stable Diffusion v1.5's gradient, counted without computing anything.

Tensors are fake: they have shapes, and storages whose bytes are counted as they come and go.
"""

from __future__ import annotations

import argparse

import torch
from diffusers import AutoencoderKL, UNet2DConditionModel
from torch._subclasses.fake_tensor import FakeTensorMode

from cnca.gen.live_memory import LiveMemory

VAE = {
    "block_out_channels": (128, 256, 512, 512),
    "down_block_types": ("DownEncoderBlock2D",) * 4,
    "latent_channels": 4,
    "layers_per_block": 2,
    "up_block_types": ("UpDecoderBlock2D",) * 4,
}


def gibibytes(count: float) -> str:
    """Readable."""
    return f"{count / 2**30:.1f} GiB"


parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--size", type=int, default=512, help="texture's side in pixels")
arguments = parser.parse_args()
side = arguments.size // 8
for half in (None, torch.bfloat16):
    with FakeTensorMode():
        unet = UNet2DConditionModel(sample_size=64, cross_attention_dim=768).requires_grad_(False)
        vae = AutoencoderKL(**VAE).requires_grad_(False)
        weights = sum(p.nbytes for part in (unet, vae) for p in part.parameters())
        with LiveMemory() as step, torch.autocast("cpu", half, enabled=half is not None):
            latents = torch.randn(2, 4, side, side, requires_grad=True)
            tokens = torch.randn(2, 154, 768, requires_grad=True)
            unet(latents, torch.tensor(1), tokens).sample.sum().backward()
        with LiveMemory() as decoding:
            latents = torch.randn(1, 4, side, side, requires_grad=True)
            vae.decode(latents).sample.sum().backward()
    print(
        f"{half or torch.float32}: weights {gibibytes(weights)}, one step "
        f"{gibibytes(step.peak)}, decoding {gibibytes(decoding.peak)} beside them"
    )
