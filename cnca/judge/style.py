"""A judge of style: which of some prompts does a texture show?

**In no loss.**  An attack that descends a judge's gradient learns to please the judge.  This one is
therefore kept from every attack: another network than the prompt scorer (residual blocks and two
classifiers where that compares features), trained with another seed, on other pictures, with other
variations; its answers carry no gradient; and no room that an attack is made of may import it
(``tests/judge/test_style.py``).

It tells *pattern* and *colors* apart, and a prompt that names both must be right in both:

    log p(prompt | texture) = log p(pattern) + Σ_w log p(word w is, or is not, among the colors)

averaged over overlapping windows of 256 texels, the generator's own size: a texture of 512² shows
patterns of the same size as one of 256², and more of them.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
import torch.nn.functional as F
from jaxtyping import Float
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from cnca.core.errors import GeneratorError, did_you_mean
from cnca.core.files import replacing
from cnca.core.types import SrgbImages, SrgbTexture
from cnca.gen.palettes import COLOR_WORDS
from cnca.gen.scorer import words
from cnca.gen.textures import PAPER_PROMPTS, STYLES

SHIPPED_JUDGE = Path(__file__).parents[1] / "assets" / "style_judge" / "style_judge.safetensors"
TEN_PROMPTS = (
    *PAPER_PROMPTS,
    "green camouflage",
    "black white stripes",
    "orange black leopard",
    "blue waves",
)
"""The paper's six and four others: of the same pattern or of the same colors, or near to both."""
WINDOW = 256
"""Texels per side that are looked at in one piece, as in the generator's textures."""
SIDE = 96
"""Pixels per side to which a window is shrunk."""
KNOWS = json.dumps({"styles": list(STYLES), "colors": list(COLOR_WORDS)})
"""What the outputs stand for, kept beside the weights."""


@dataclass(frozen=True)
class PromptMeaning:
    """What a prompt says, in the words that the judge knows."""

    style: int
    """Its pattern's place in ``STYLES``."""
    colors: Float[Tensor, " words"]
    """1 for each of ``COLOR_WORDS`` that it names, or that its pattern has by nature; else 0."""


def meaning(prompt: str) -> PromptMeaning:
    """Read a prompt: the noun with most words decides, as in "zebra strips" against "strips".

    Raises GeneratorError for a prompt that names none of the patterns that the judge knows.
    """
    said = words(prompt)
    nouns = {noun: style for style, kind in STYLES.items() for noun in (style, *kind.nouns)}
    named = [noun for noun in nouns if set(noun.split()) <= set(said)]
    if not named:
        hints = [did_you_mean(word, STYLES) for word in said]
        raise GeneratorError(
            f"prompt '{prompt}': names no pattern that the judge of style knows; there is "
            f"{', '.join(STYLES)}{next(filter(None, hints), '')}"
        )
    style = nouns[max(named, key=lambda noun: len(noun.split()))]
    colors = [word for word in said if word in COLOR_WORDS] or STYLES[style].natural.split()
    return PromptMeaning(
        list(STYLES).index(style), torch.tensor([float(word in colors) for word in COLOR_WORDS])
    )


class StyleJudge(nn.Module):
    """A small residual network (He et al. 2016) with a classifier of patterns and one of colors."""

    def __init__(self) -> None:
        super().__init__()
        self.look = nn.Sequential(
            nn.Conv2d(3, 32, 5, stride=2, padding=2, bias=False),
            nn.BatchNorm2d(32),
            nn.ReLU(),
            nn.MaxPool2d(2),
            ResidualBlock(32, 64, stride=1),
            ResidualBlock(64, 96, stride=2),
            ResidualBlock(96, 128, stride=2),
        )
        self.style = nn.Linear(2 * 128, len(STYLES))
        self.colors = nn.Linear(2 * 128, len(COLOR_WORDS))

    def forward(
        self, windows: SrgbImages
    ) -> tuple[Float[Tensor, "windows styles"], Float[Tensor, "windows words"]]:
        """Logits of patterns and of color words; windows of any size are shrunk to ``SIDE``."""
        small = F.interpolate(windows, (SIDE, SIDE), mode="bilinear", antialias=True)
        maps = self.look(2.0 * small - 1.0).flatten(2)
        features = torch.cat([maps.mean(dim=2), maps.amax(dim=2)], dim=1)
        return self.style(features), self.colors(features)

    @torch.no_grad()
    def judge(self, texture: SrgbTexture, prompts: Sequence[str]) -> Float[Tensor, " prompts"]:
        """Return how likely it is that ``texture`` shows each of ``prompts``: shares that sum to 1.

        Without gradient, whatever the caller asks for.

        Raises:
            GeneratorError: a prompt that the judge cannot read.
        """
        styles, colors = self(windows(texture))
        log_styles = F.log_softmax(styles, dim=1)
        scores = []
        for prompt in map(meaning, prompts):
            wanted = prompt.colors.expand_as(colors)
            wrong = F.binary_cross_entropy_with_logits(colors, wanted, reduction="none")
            scores.append((log_styles[:, prompt.style] - wrong.sum(dim=1)).mean())
        return torch.stack(scores).softmax(dim=0)

    def save(self, path: Path) -> None:
        """Write the weights as float16 safetensors."""
        weights = {name: value.half().contiguous() for name, value in self._stored().items()}
        with replacing(path) as temporary:
            save_file(weights, temporary, {"knows": KNOWS})

    @classmethod
    def load(cls, path: Path = SHIPPED_JUDGE) -> StyleJudge:
        """Read what :meth:`save` wrote; raises GeneratorError for any other file."""
        judge = cls()
        try:
            with safe_open(path, framework="pt") as file:
                known = file.metadata() or {}
                weights = {name: file.get_tensor(name).float() for name in file.keys()}  # noqa: SIM118
            if known["knows"] != KNOWS:
                raise ValueError("it was trained for other patterns or colors")
            if not all(bool(value.isfinite().all()) for value in weights.values()):
                raise ValueError("weights that are not finite")
            judge._stored_from(weights)
        except (OSError, SafetensorError, KeyError, ValueError, TypeError, RuntimeError) as error:
            reason = str(error).splitlines()[0]
            raise GeneratorError(
                f"{path}: no judge of style ({reason}); give a file of cnca train-style-judge"
            ) from error
        return judge.eval().requires_grad_(False)

    def _stored(self) -> dict[str, Tensor]:
        """Weights and statistics, without counters of training steps."""
        state = self.state_dict()
        return {name: t for name, t in state.items() if not name.endswith("num_batches_tracked")}

    def _stored_from(self, weights: dict[str, Tensor]) -> None:
        if weights.keys() != self._stored().keys():
            raise ValueError("weights of another network")
        self.load_state_dict(weights, strict=False)


class ResidualBlock(nn.Module):
    """Two convolutions beside a projection."""

    def __init__(self, inputs: int, outputs: int, *, stride: int) -> None:
        super().__init__()
        self.change = nn.Sequential(
            nn.Conv2d(inputs, outputs, 3, stride=stride, padding=1, bias=False),
            nn.BatchNorm2d(outputs),
            nn.ReLU(),
            nn.Conv2d(outputs, outputs, 3, padding=1, bias=False),
            nn.BatchNorm2d(outputs),
        )
        self.keep = nn.Sequential(
            nn.Conv2d(inputs, outputs, 1, stride=stride, bias=False), nn.BatchNorm2d(outputs)
        )

    def forward(self, maps: Float[Tensor, "batch in height width"]) -> Tensor:
        """Maps of ``outputs`` channels, ``stride`` times smaller."""
        return F.relu(self.change(maps) + self.keep(maps))


def windows(texture: SrgbTexture) -> SrgbImages:
    """Overlapping squares that cover a texture, half a window apart; a smaller one as it is."""
    height, width = texture.shape[1:]
    tops, lefts = _starts(height), _starts(width)
    cuts = [texture[:, y : y + WINDOW, x : x + WINDOW] for y in tops for x in lefts]
    return SrgbImages(torch.stack(cuts))


def _starts(length: int) -> list[int]:
    """Where windows begin along one side; the last one ends with it."""
    if length <= WINDOW:
        return [0]
    return sorted({*range(0, length - WINDOW, WINDOW // 2), length - WINDOW})
