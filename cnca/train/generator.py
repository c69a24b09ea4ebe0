"""Training of the shipped generator: corpus → autoencoder → latents → U-Net.

The stages follow latent diffusion (Rombach et al. 2022).
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import torch
import torch.nn.functional as F
from diffusers import AutoencoderKL, StableDiffusionPipeline
from jaxtyping import Float
from torch import Tensor

from cnca.core.files import replacing
from cnca.core.progress import track
from cnca.gen import architecture
from cnca.train import corpus
from cnca.train.corpus import Corpus
from cnca.train.denoiser import Denoiser, text_features, train_denoiser
from cnca.train.loop import TrainingLoop


def train_generator(
    out: Path,
    *,
    seed: int = 0,
    resume: bool = True,
    pictures: int = 4096,
    autoencoder_steps: int = 5000,
    denoiser_steps: tuple[int, int, int, int] = (1000, 3500, 600, 4000),
    batch: int = 16,
) -> Path:
    """Train everything and return the folder of the pipeline, ``out/pipeline``.

    ``denoiser_steps`` are those of F_adv alone and with words, on quarter pictures, on whole ones.
    Same arguments, same weights.  With ``resume``, stages and steps found in ``out`` are kept;
    without, raises RunError where there are some.
    """
    loop = TrainingLoop(out, seed, resume)
    out.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(seed)  # the parts' initial weights
    data = corpus.prepare(out, count=pictures, seed=seed)
    vae = train_autoencoder(loop, data, steps=autoencoder_steps)
    latents = encode_corpus(vae, data, out / f"latents-{pictures}-{seed}-{autoencoder_steps}.pt")
    tokenizer = architecture.word_pieces(data.captions)
    encoder = architecture.text_encoder(tokenizer).eval()
    denoiser = Denoiser(text_features([""], tokenizer, encoder)[0])
    text = text_features(data.captions, tokenizer, encoder)
    denoiser = train_denoiser(loop, denoiser, latents, text, steps=denoiser_steps, batch=batch)
    return save_pipeline(
        out / "pipeline",
        vae=architecture.with_position_channels(vae),
        unet=denoiser.unet.eval(),
        text_encoder=encoder,
        tokenizer=tokenizer,
        scheduler=denoiser.schedule,
    )


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
        for i in track(range(0, len(data.pictures), 8), "encoding textures"):
            images = _signed(torch.from_numpy(data.pictures[i : i + 8].copy()))
            chunks.append(vae.encode(images).latent_dist.mean.half())
        means = torch.cat(chunks)
        with replacing(file) as temporary:
            torch.save(means, temporary)
    scale = 1.0 / means.float().std().item()
    vae.register_to_config(scaling_factor=scale)
    return means.float() * scale


def save_pipeline(folder: Path, **parts: Any) -> Path:
    """Write the parts in diffusers format, weights as float16, in place of what was there."""
    pipeline = StableDiffusionPipeline(
        **parts, safety_checker=None, feature_extractor=None, requires_safety_checker=False
    )
    unfinished = folder.with_suffix(".tmp")
    shutil.rmtree(unfinished, ignore_errors=True)
    pipeline.to(dtype=torch.float16).save_pretrained(unfinished, safe_serialization=True)
    shutil.rmtree(folder, ignore_errors=True)
    return unfinished.rename(folder)


def _signed(pictures: Tensor) -> Float[Tensor, "batch 3 height width"]:
    """uint8 channels-last → [−1, 1] channels-first, as the autoencoder takes them."""
    return pictures.permute(0, 3, 1, 2).float() / 127.5 - 1.0
