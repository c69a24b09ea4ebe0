"""Training of the judge of style, apart from all that an attack is made of.

Its pictures are procedural textures of another seed than the corpus of the generator and the
scorer.  They are cropped, turned, mirrored, blurred as a generator's are, patched with pieces of
others and tinted, so that it goes by pattern and palette and not by a picture's finish.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import cast

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float, Int, UInt8
from torch import Tensor

from cnca.core.run_folder import RunFolder
from cnca.core.types import SrgbImages
from cnca.gen.palettes import COLOR_WORDS
from cnca.gen.textures import STYLES
from cnca.judge.style import SIDE, StyleJudge, meaning
from cnca.train.generator import corpus
from cnca.train.generator.corpus import Corpus
from cnca.train.loop import TrainingLoop
from cnca.train.task import Recipe, Task

SEED_APART = 20_011
"""Added to the seed: none of its pictures is one of the generator's or the scorer's."""
KEPT_SIDE = 128
"""Pixels per side of the pictures in memory."""
SMALLEST_CROP = 0.7
PATCHED, BLURRED = 0.25, 0.4
"""Shares of the batches that are patched, and blurred."""
GAIN, OFFSET, NOISE = 0.12, 0.06, 0.04
"""Deviations of tints, brightness and noise of each picture."""
SMOOTHING = 0.05

Kept = Float[Tensor, "batch 3 kept kept"]
"""sRGB images in [0, 1] at the size that is kept in memory."""
Labelled = tuple[SrgbImages, Int[Tensor, " batch"], Float[Tensor, "batch words"]]


@dataclass(frozen=True)
class Trained:
    """A judge's file, and how often it was right about unseen procedural textures."""

    file: Path
    style: float
    """Share of right patterns out of all."""
    colors: float
    """Share of textures of which all color words are right."""
    pictures: int


class StyleJudgeTask(Task[Labelled]):
    """Learns patterns by cross entropy and color words by one cross entropy for each."""

    name = "style-judge"
    network: StyleJudge

    def __init__(self, data: Corpus, *, steps: int, batch: int) -> None:
        self.network = StyleJudge()
        self.recipe = Recipe(steps, 2e-3, save_every=50, averaging=0.995)
        self.settings = {"batch": batch}
        self._batch = batch
        self._pictures = shrunk(data.pictures)
        self._styles, self._colors = labels(data.captions)

    def batch(self, step: int, rng: torch.Generator) -> Labelled:
        """Varied pictures with their patterns and color words."""
        chosen = torch.randint(len(self._pictures), (self._batch,), generator=rng)
        pictures = self._pictures[chosen].permute(0, 3, 1, 2).float() / 255
        return varied(pictures, rng), self._styles[chosen], self._colors[chosen]

    def losses(self, batch: Labelled, rng: torch.Generator) -> dict[str, Tensor]:
        """Cross entropies of the pattern and, summed over the words, of the colors."""
        pictures, wanted_styles, wanted_colors = batch
        with torch.autocast("cpu", torch.bfloat16):
            styles, colors = self.network(pictures)
        style = F.cross_entropy(styles.float(), wanted_styles, label_smoothing=SMOOTHING)
        color = F.binary_cross_entropy_with_logits(colors.float(), wanted_colors)
        return {"style": style, "colors": len(COLOR_WORDS) / 4 * color}


def train_style_judge(
    out: Path,
    *,
    seed: int = 0,
    resume: bool = False,
    pictures: int = 6144,
    steps: int = 1700,
    batch: int = 64,
    held_out: int = 320,
) -> Trained:
    """Paint a corpus, train on it, write ``out/style_judge.safetensors``, test it on new textures.

    Raises RunError where ``out`` holds a training and ``resume`` is not asked for.
    """
    loop = TrainingLoop(out, seed, resume)
    asked = {"seed": seed, "pictures": pictures, "steps": steps, "batch": batch}
    RunFolder(out, "train-style-judge").claim(asked, {}, resume=resume)
    data = corpus.prepare(out, count=pictures, seed=seed + SEED_APART)
    torch.manual_seed(seed + SEED_APART)
    file = out / "style_judge.safetensors"
    cast(StyleJudge, loop.run(StyleJudgeTask(data, steps=steps, batch=batch))).save(file)
    unseen = corpus.prepare(out, count=held_out, seed=seed + 2 * SEED_APART)
    return tested(file, unseen)


@torch.no_grad()
def tested(file: Path, unseen: Corpus) -> Trained:
    """How often the judge in ``file`` is right about the pictures of a corpus."""
    judge = StyleJudge.load(file)
    wanted_styles, wanted_colors = labels(unseen.captions)
    pictures = torch.from_numpy(np.array(unseen.pictures)).permute(0, 3, 1, 2)
    answers = [judge(chunk.float() / 255) for chunk in pictures.split(32)]
    styles, colors = (torch.cat(part) for part in zip(*answers, strict=True))
    right_styles = (styles.argmax(dim=1) == wanted_styles).float().mean()
    right_colors = ((colors > 0) == (wanted_colors > 0.5)).all(dim=1).float().mean()
    return Trained(file, float(right_styles), float(right_colors), len(pictures))


def labels(captions: list[str]) -> tuple[Int[Tensor, " captions"], Float[Tensor, "captions words"]]:
    """The place of each caption's pattern in ``STYLES``, and which color words hold."""
    meant = [meaning(caption) for caption in captions]
    assert all(0 <= m.style < len(STYLES) for m in meant)
    return torch.tensor([m.style for m in meant]), torch.stack([m.colors for m in meant])


def shrunk(
    pictures: UInt8[np.ndarray, "count height width 3"],
) -> UInt8[Tensor, "count side side 3"]:
    """The corpus at the size that is kept in memory."""
    size = (KEPT_SIDE, KEPT_SIDE)
    small = [cv2.resize(picture, size, interpolation=cv2.INTER_AREA) for picture in pictures]
    return torch.from_numpy(np.stack(small))


def varied(pictures: Kept, rng: torch.Generator) -> SrgbImages:
    """Crops of ``SIDE``, turned and mirrored, some blurred or patched with others, all tinted."""
    changed: Tensor = _crop(pictures, rng)
    if _draw(rng) < 0.5:
        changed = changed.flip(3)
    changed = changed.rot90(int(torch.randint(4, (), generator=rng)), dims=(2, 3))
    if _draw(rng) < PATCHED:
        changed = _patched(SrgbImages(changed), rng)
    if _draw(rng) < BLURRED:
        coarse = 1.2 + 1.3 * _draw(rng)
        small = F.interpolate(changed, scale_factor=1 / coarse, mode="bilinear", antialias=True)
        changed = F.interpolate(small, (SIDE, SIDE), mode="bicubic").clamp(0, 1)
    count = len(changed)
    gain = (GAIN * torch.randn(count, 3, 1, 1, generator=rng)).exp()
    offset = OFFSET * torch.randn(count, 1, 1, 1, generator=rng)
    noise = NOISE * _draw(rng) * torch.randn(changed.shape, generator=rng)
    return SrgbImages((changed * gain + offset + noise).clamp(0, 1))


def _draw(rng: torch.Generator) -> float:
    return float(torch.rand((), generator=rng))


def _crop(pictures: Kept, rng: torch.Generator) -> SrgbImages:
    """One size for the batch, another place for each picture."""
    whole = pictures.shape[-1]
    side = round(whole * (SMALLEST_CROP + (1 - SMALLEST_CROP) * _draw(rng)))
    places = torch.randint(whole - side + 1, (len(pictures), 2), generator=rng).tolist()
    cuts = [
        picture[:, y : y + side, x : x + side]
        for picture, (y, x) in zip(pictures, places, strict=True)
    ]
    small = torch.stack(cuts)
    return SrgbImages(F.interpolate(small, (SIDE, SIDE), mode="bilinear", antialias=True))


def _patched(pictures: SrgbImages, rng: torch.Generator) -> SrgbImages:
    """A soft blob of up to a fifth of each picture shows the next picture of the batch."""
    field = torch.randn(len(pictures), 1, 4, 4, generator=rng)
    field = F.interpolate(field, pictures.shape[-2:], mode="bicubic")
    level = field.flatten(1).quantile(0.8 + 0.2 * _draw(rng), dim=1).view(-1, 1, 1, 1)
    blob = (4 * (field - level)).sigmoid()
    return SrgbImages(blob * pictures.roll(1, dims=0) + (1 - blob) * pictures)
