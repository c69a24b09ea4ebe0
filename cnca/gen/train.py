"""Training of the shipped generator: corpus → autoencoder → latents → text encoder and U-Net.

The stages follow latent diffusion (Rombach et al. 2022).  The tokens that F_adv will take at
attack time are trained as *image prompt* tokens (after the idea of IP-Adapter, Ye et al. 2023):
in half of the samples they describe the picture coarsely, in the other half they are zero.  So
cross-attention listens to them, values in [−1, 1] are in its range, and zero means "no wish".
"""

from __future__ import annotations

import shutil
from pathlib import Path

import torch
import torch.nn.functional as F
from diffusers import AutoencoderKL, StableDiffusionPipeline
from jaxtyping import Float
from torch import Tensor, nn

from cnca.gen import architecture, corpus
from cnca.gen.corpus import Corpus
from cnca.gen.training_loop import TrainingLoop

FEATURE_TOKENS = 8
"""Tokens of F_adv that the generator is trained with."""


def train_generator(
    out: Path,
    *,
    seed: int = 0,
    resume: bool = True,
    pictures: int = 4000,
    autoencoder_steps: int = 650,
    denoiser_steps: int = 3000,
    batch: int = 8,
) -> Path:
    """Train everything and return the folder of the pipeline, ``out/pipeline``.

    Same arguments, same weights.  With ``resume``, stages and steps found in ``out`` are kept.
    """
    out.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(seed)  # the parts' initial weights
    data = corpus.prepare(out, count=pictures, seed=seed)
    loop = TrainingLoop(out, seed, resume)
    vae = train_autoencoder(loop, data, steps=autoencoder_steps)
    latents = encode_corpus(vae, data, out / f"latents-{pictures}-{seed}-{autoencoder_steps}.pt")
    return train_denoiser(loop, vae, latents, data, steps=denoiser_steps, batch=batch)


def train_autoencoder(
    loop: TrainingLoop, data: Corpus, *, steps: int, crop: int = 64, batch: int = 4
) -> AutoencoderKL:
    """Train on random crops: absolute error of colours and of edges, and a light KL term."""
    vae = architecture.autoencoder().to(memory_format=torch.channels_last)

    def loss(generator: torch.Generator) -> Tensor:
        images = random_crops(data, batch, crop, generator)
        with torch.autocast("cpu", torch.bfloat16):
            posterior = vae.encode(images).latent_dist
            decoded = vae.decode(posterior.sample(generator)).sample.float()
        colour = F.l1_loss(decoded, images)
        edges = sum(F.l1_loss(decoded.diff(dim=d), images.diff(dim=d)) for d in (-2, -1))
        return colour + edges + 1e-5 * posterior.kl().mean() / posterior.mean[0].numel()

    return loop.run("autoencoder", vae, loss, steps=steps, learning_rate=1e-3, average=0.99).eval()


def random_crops(
    data: Corpus, batch: int, crop: int, generator: torch.Generator
) -> Float[Tensor, "batch 3 crop crop"]:
    """Square cut-outs, mirrored at random, sRGB scaled to [−1, 1]."""
    cuts = []
    for _ in range(batch):
        i = int(torch.randint(len(data.pictures), (), generator=generator))
        side = data.pictures.shape[1]
        top, left = torch.randint(side - crop + 1, (2,), generator=generator).tolist()
        cut = torch.from_numpy(data.pictures[i, top : top + crop, left : left + crop].copy())
        cuts.append(cut.flip(1) if torch.rand((), generator=generator) < 0.5 else cut)
    return _signed(torch.stack(cuts))


@torch.no_grad()
def encode_corpus(
    vae: AutoencoderKL, data: Corpus, file: Path
) -> Float[Tensor, "pictures 4 32 32"]:
    """Posterior means of all pictures, scaled to unit deviation; kept in ``file``.

    Sets ``vae.config.scaling_factor`` (Rombach et al. 2022, section 3.3 of the supplement).
    """
    if file.exists():
        means = torch.load(file, weights_only=True)
    else:
        chunks = []
        for i in range(0, len(data.pictures), 8):
            images = _signed(torch.from_numpy(data.pictures[i : i + 8].copy()))
            chunks.append(vae.encode(images).latent_dist.mean.half())
        means = torch.cat(chunks)
        torch.save(means, file.with_suffix(".tmp"))
        file.with_suffix(".tmp").replace(file)
    scale = 1.0 / means.float().std().item()
    vae.register_to_config(scaling_factor=scale)
    return means.float() * scale


class ImagePrompt(nn.Module):
    """Describes latents by as many tokens as F_adv has: token k speaks of the k-th eighth.

    Needed in training only.
    """

    def __init__(self, tokens: int = FEATURE_TOKENS) -> None:
        super().__init__()
        self.tokens = tokens
        self.project = nn.Parameter(torch.randn(tokens, 4 * tokens, architecture.TEXT_WIDTH))

    def forward(
        self, latents: Float[Tensor, "batch 4 32 32"], generator: torch.Generator
    ) -> Float[Tensor, "batch tokens width"]:
        """Return tokens in [−1, 1]; all zero for half of the batch, a quarter of the others."""
        coarse = F.adaptive_avg_pool2d(latents, self.tokens).permute(0, 2, 1, 3).flatten(2)
        scale = (4 * self.tokens) ** -0.5
        tokens = torch.tanh(scale * torch.einsum("bkc,kcw->bkw", coarse, self.project))
        silent = torch.rand(len(latents), 1, 1, generator=generator) < 0.5
        dropped = torch.rand(len(latents), self.tokens, 1, generator=generator) < 0.25
        return tokens.masked_fill(silent | dropped, 0.0)


def train_denoiser(
    loop: TrainingLoop,
    vae: AutoencoderKL,
    latents: Float[Tensor, "pictures 4 32 32"],
    data: Corpus,
    *,
    steps: int,
    batch: int,
) -> Path:
    """Train text encoder and U-Net together on v-prediction and save the whole pipeline."""
    tokenizer = architecture.word_pieces(data.captions)
    parts = nn.ModuleDict(
        {
            "text_encoder": architecture.text_encoder(tokenizer),
            "unet": architecture.denoiser(),
            "image_prompt": ImagePrompt(),
        }
    )
    noise_schedule = architecture.scheduler()
    pad = {"padding": "max_length", "return_tensors": "pt"}
    words = tokenizer(data.captions, **pad).input_ids
    nothing = tokenizer("", **pad).input_ids

    def loss(generator: torch.Generator) -> Tensor:
        chosen = torch.randint(len(latents), (batch,), generator=generator)
        clean = latents[chosen]
        # classifier-free guidance (Ho & Salimans 2022): sometimes neither text nor F_adv
        blind = torch.rand(batch, 1, generator=generator) < 0.1
        text = parts["text_encoder"](torch.where(blind, nothing, words[chosen])).last_hidden_state
        extra = parts["image_prompt"](clean, generator).masked_fill(blind[..., None], 0.0)
        alone = torch.rand((), generator=generator) < 0.1  # without F_adv there are 77 tokens
        condition = text if alone else torch.cat([extra, text], dim=1)
        times = torch.randint(len(noise_schedule.betas), (batch,), generator=generator)
        noise = torch.randn(clean.shape, generator=generator)
        noisy = noise_schedule.add_noise(clean, noise, times)
        velocity = noise_schedule.get_velocity(clean, noise, times)
        return F.mse_loss(parts["unet"](noisy, times, condition).sample, velocity)

    trained = loop.run("denoiser", parts, loss, steps=steps, learning_rate=1e-3, average=0.998)
    pipeline = StableDiffusionPipeline(
        vae=vae,
        text_encoder=trained["text_encoder"].eval(),
        tokenizer=tokenizer,
        unet=trained["unet"].eval(),
        scheduler=noise_schedule,
        safety_checker=None,
        feature_extractor=None,
        requires_safety_checker=False,
    )
    folder = loop.folder / "pipeline"
    unfinished = loop.folder / "pipeline.tmp"
    shutil.rmtree(unfinished, ignore_errors=True)
    pipeline.to(dtype=torch.float16).save_pretrained(unfinished, safe_serialization=True)
    shutil.rmtree(folder, ignore_errors=True)
    return unfinished.rename(folder)


def _signed(pictures: Tensor) -> Float[Tensor, "batch 3 height width"]:
    """uint8 channels-last → [−1, 1] channels-first, as the autoencoder takes them."""
    return pictures.permute(0, 3, 1, 2).float() / 127.5 - 1.0
