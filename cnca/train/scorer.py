"""Training of the shipped prompt scorer, on the corpus of the generator and apart from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from cnca.core.run_folder import RunFolder
from cnca.core.types import SrgbImages
from cnca.gen import textures
from cnca.gen.scorer import SIDE, BagScorer, right_prompts, words
from cnca.train.generator import corpus
from cnca.train.generator.corpus import Corpus
from cnca.train.loop import TrainingLoop
from cnca.train.task import Recipe, Task

HELD_OUT_SEED = 7_919
"""Added to the seed for the pictures that judge the scorer: none is in the corpus."""


@dataclass(frozen=True)
class Trained:
    """A scorer's file, and how often it picked the right prompt out of ten for unseen pictures."""

    file: Path
    right: float
    pictures: int


class ScorerTask(Task[tuple[SrgbImages, list[str]]]):
    """Learns which captions belong to which pictures of the corpus."""

    name = "scorer"
    network: BagScorer

    def __init__(self, data: Corpus, *, steps: int, batch: int) -> None:
        self.network = BagScorer(sorted({w for caption in data.captions for w in words(caption)}))
        self.recipe = Recipe(steps, 2e-3)
        self.settings = {"batch": batch}
        self._small, self._captions, self._batch = shrunk(data.pictures), data.captions, batch

    def batch(self, step: int, rng: torch.Generator) -> tuple[SrgbImages, list[str]]:
        """Varied pictures and their captions."""
        chosen = torch.randint(len(self._small), (self._batch,), generator=rng)
        captions = [self._captions[i] for i in chosen.tolist()]
        return varied(SrgbImages(self._small[chosen]), rng), captions

    def losses(
        self, batch: tuple[SrgbImages, list[str]], rng: torch.Generator
    ) -> dict[str, Tensor]:
        """The contrastive loss."""
        return {"contrastive": contrastive_loss(self.network, *batch)}


def train_scorer(
    out: Path,
    *,
    data: Path,
    seed: int = 0,
    resume: bool = True,
    pictures: int = 4096,
    steps: int = 800,
    batch: int = 128,
    held_out: int = 200,
) -> Trained:
    """Train on the corpus in ``data`` (made if missing), write ``out/scorer.safetensors``.

    Raises RunError where ``out`` holds a training and ``resume`` is not asked for.
    """
    loop = TrainingLoop(out, seed, resume)
    asked = {"seed": seed, "pictures": pictures, "steps": steps, "batch": batch}
    RunFolder(out, "train-scorer").claim(asked, {}, resume=resume)
    torch.manual_seed(seed)
    task = ScorerTask(corpus.prepare(data, count=pictures, seed=seed), steps=steps, batch=batch)
    file = out / "scorer.safetensors"
    cast(BagScorer, loop.run(task)).save(file)
    unseen, captions = held_out_textures(held_out, seed)
    hits = right_prompts(BagScorer.load(file), unseen, captions, choices=10, seed=seed)
    return Trained(file, sum(hits) / len(hits), len(hits))


def contrastive_loss(scorer: BagScorer, pictures: SrgbImages, captions: Sequence[str]) -> Tensor:
    """Cross entropy of finding the captions of pictures and the pictures of captions.

    Captions of the same words are all right answers.
    """
    cosines = scorer.see_pictures(pictures) @ scorer.read_prompts(captions).T
    logits = scorer.log_scale.exp() * cosines
    bags = [frozenset(words(caption)) for caption in captions]
    same = torch.tensor([[bag == other for other in bags] for bag in bags], dtype=torch.float32)
    wanted = same / same.sum(dim=1, keepdim=True)
    return (F.cross_entropy(logits, wanted) + F.cross_entropy(logits.T, wanted)) / 2


def varied(pictures: SrgbImages, rng: torch.Generator) -> SrgbImages:
    """Mirrored and shifted around at random, half of them blurred as a generator's are."""
    flips = torch.rand(len(pictures), 1, 1, 1, generator=rng) < 0.5
    pictures = SrgbImages(torch.where(flips, pictures.flip(3), pictures))
    shift = torch.randint(pictures.shape[-1], (2,), generator=rng).tolist()
    pictures = SrgbImages(pictures.roll(shift, dims=(2, 3)))
    blurred = F.avg_pool2d(F.pad(pictures, (1, 1, 1, 1), mode="reflect"), 3, stride=1)
    soft = torch.rand(len(pictures), 1, 1, 1, generator=rng) < 0.5
    return SrgbImages(torch.where(soft, blurred, pictures))


def shrunk(pictures: np.ndarray) -> SrgbImages:
    """uint8 pictures (count, height, width, 3) as small sRGB images in [0, 1]."""
    chunks = []
    for start in range(0, len(pictures), 64):
        whole = torch.from_numpy(pictures[start : start + 64].copy()).permute(0, 3, 1, 2)
        chunks.append(F.interpolate(whole / 255.0, (SIDE, SIDE), mode="bilinear", antialias=True))
    return SrgbImages(torch.cat(chunks))


def held_out_textures(count: int, seed: int) -> tuple[SrgbImages, list[str]]:
    """Freshly painted textures, (count, 3, 256, 256), with their captions."""
    drawn = [
        textures.sample(np.random.default_rng([seed + HELD_OUT_SEED, i])) for i in range(count)
    ]
    pictures = np.stack([np.clip(texture.picture, 0, 1) for texture in drawn]).astype(np.float32)
    images = SrgbImages(torch.from_numpy(pictures).permute(0, 3, 1, 2))
    return images, [texture.caption for texture in drawn]
