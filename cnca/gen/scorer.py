"""How well a picture fits a prompt: cosines of a picture's and a text's features.

The idea is CLIP's (Radford et al. 2021).  What ships is a small network of our own that knows the
words of the shipped generator's captions; any CLIP folder in ``transformers`` format does as well.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import torch
import torch.nn.functional as F
from jaxtyping import Float
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from cnca.core.errors import GeneratorError
from cnca.core.files import replacing
from cnca.core.types import SrgbImages

SHIPPED_SCORER = Path(__file__).parents[1] / "assets" / "scorer" / "scorer.safetensors"
SIDE = 64
"""Pixels per side of the pictures that the shipped scorer looks at."""
WIDTH = 128
"""Length of its features."""

Cosines = Float[Tensor, "pictures prompts"]


class PromptScorer(Protocol):
    """Compares pictures with prompts."""

    def score(self, pictures: SrgbImages, prompts: Sequence[str]) -> Cosines:
        """Return the cosine in [−1, 1] of every picture with every prompt.

        Differentiable in the pictures.

        Raises :class:`GeneratorError` for a prompt that the scorer cannot read.
        """


def load_scorer(path: Path | None = None) -> PromptScorer:
    """Load the shipped scorer, one written by ``cnca train-scorer``, or a CLIP folder.

    Raises :class:`GeneratorError` for anything else.
    """
    if path is not None and path.is_dir():
        from cnca.gen.clip_scorer import ClipScorer

        return ClipScorer.load(path)
    return BagScorer.load(path or SHIPPED_SCORER)


class BagScorer(nn.Module):
    """A convolutional network beside a bag of words, trained to agree (contrastively)."""

    def __init__(self, vocabulary: Sequence[str]) -> None:
        super().__init__()
        self.vocabulary = {word: i for i, word in enumerate(vocabulary)}
        self.look = nn.Sequential(
            *_block(3, 32, stride=2),
            *_block(32, 64, stride=2),
            *_block(64, 128, stride=2),
            *_block(128, 128, stride=1),
        )
        self.see = nn.Linear(2 * 128, WIDTH)
        self.words = nn.EmbeddingBag(len(vocabulary), WIDTH, mode="sum")
        self.read = nn.Sequential(
            nn.Linear(WIDTH, 2 * WIDTH), nn.SiLU(), nn.Linear(2 * WIDTH, WIDTH)
        )
        self.log_scale = nn.Parameter(torch.tensor(2.5))
        """Logarithm of what cosines are multiplied by in the loss."""

    def see_pictures(self, pictures: SrgbImages) -> Float[Tensor, "pictures features"]:
        """Unit features of pictures of any size."""
        small = F.interpolate(pictures, (SIDE, SIDE), mode="bilinear", antialias=True)
        maps = self.look(2.0 * small - 1.0).flatten(2)
        return F.normalize(self.see(torch.cat([maps.mean(dim=2), maps.std(dim=2)], dim=1)), dim=1)

    def read_prompts(self, prompts: Sequence[str]) -> Float[Tensor, "prompts width"]:
        """Unit features of prompts; words that no caption had are passed over.

        Raises :class:`GeneratorError` where none is left.
        """
        bags = [[self.vocabulary[w] for w in words(p) if w in self.vocabulary] for p in prompts]
        for prompt, bag in zip(prompts, bags, strict=True):
            if not bag:
                raise GeneratorError(
                    f"prompt '{prompt}': the shipped scorer knows none of its words; "
                    "give --scorer a CLIP folder"
                )
        starts = torch.tensor([0] + [len(bag) for bag in bags[:-1]]).cumsum(0)
        summed = self.words(torch.tensor([i for bag in bags for i in bag]), starts)
        return F.normalize(self.read(summed), dim=1)

    def score(self, pictures: SrgbImages, prompts: Sequence[str]) -> Cosines:
        """Return the cosine of every picture with every prompt."""
        return self.see_pictures(pictures) @ self.read_prompts(prompts).T

    def save(self, path: Path) -> None:
        """Write weights as float16 and the vocabulary into one safetensors file."""
        weights = {name: value.half().contiguous() for name, value in self.state_dict().items()}
        with replacing(path) as temporary:
            save_file(weights, temporary, {"words": json.dumps(list(self.vocabulary))})

    @classmethod
    def load(cls, path: Path) -> BagScorer:
        """Read what :meth:`save` wrote; raises :class:`GeneratorError` for any other file."""
        try:
            with safe_open(path, framework="pt") as file:
                scorer = cls(json.loads((file.metadata() or {})["words"]))
                weights = {name: file.get_tensor(name).float() for name in file.keys()}  # noqa: SIM118
            scorer.load_state_dict(weights)
        except (OSError, SafetensorError, KeyError, ValueError, TypeError, RuntimeError) as error:
            reason = str(error).splitlines()[0]
            raise GeneratorError(
                f"{path}: no prompt scorer ({reason}); give a file of cnca train-scorer, "
                "or a CLIP folder"
            ) from error
        return scorer.eval().requires_grad_(False)


def words(prompt: str) -> list[str]:
    """The lower-case words of a prompt."""
    return re.findall(r"[a-z]+", prompt.lower())


def right_prompts(
    scorer: PromptScorer, pictures: SrgbImages, prompts: Sequence[str], *, choices: int, seed: int
) -> list[bool]:
    """Whether each picture's own prompt scores best among ``choices``, the others drawn at random.

    The others are made of other words.  Raises :class:`GeneratorError` where there are too few.
    """
    with torch.no_grad():
        cosines = scorer.score(pictures, prompts)
    chance, hits = torch.Generator().manual_seed(seed), []
    for i, prompt in enumerate(prompts):
        rivals = [j for j, other in enumerate(prompts) if set(words(other)) != set(words(prompt))]
        if len(rivals) < choices - 1:
            raise GeneratorError(f"{len(prompts)} prompts: too few to choose one of {choices}")
        drawn = torch.randperm(len(rivals), generator=chance)[: choices - 1]
        best = max(cosines[i, rivals[k]].item() for k in drawn.tolist())
        hits.append(cosines[i, i].item() > best)
    return hits


def _block(inputs: int, outputs: int, *, stride: int) -> tuple[nn.Module, ...]:
    return (
        nn.Conv2d(inputs, outputs, 3, stride=stride, padding=1),
        nn.GroupNorm(8, outputs),
        nn.SiLU(),
    )
