"""Training of the shipped generator: corpus → autoencoder → latents → U-Net.

The stages follow latent diffusion (Rombach et al. 2022).
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any, cast

import torch
from diffusers import AutoencoderKL, StableDiffusionPipeline
from jaxtyping import Float
from torch import Tensor

from cnca.core.files import replacing
from cnca.core.progress import track
from cnca.core.run_folder import RunFolder
from cnca.gen import architecture
from cnca.train.generator import corpus
from cnca.train.generator.autoencoder import AutoencoderTask, signed
from cnca.train.generator.corpus import Corpus
from cnca.train.generator.denoiser import Denoiser, text_features, train_denoiser
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
    asked: dict[str, object] = {"seed": seed, "pictures": pictures, "batch": batch}
    asked |= {"autoencoder_steps": autoencoder_steps, "denoiser_steps": list(denoiser_steps)}
    RunFolder(out, "train-generator").claim(asked, {}, resume=resume)
    torch.manual_seed(seed)  # the parts' initial weights
    data = corpus.prepare(out, count=pictures, seed=seed)
    vae = cast(AutoencoderKL, loop.run(AutoencoderTask(data, steps=autoencoder_steps)).eval())
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
            images = signed(torch.from_numpy(data.pictures[i : i + 8].copy()))
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
