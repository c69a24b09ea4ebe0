"""``cnca judge-style``: which of some prompts textures show, by a judge that no attack knows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import torch

from cnca.core.errors import GeneratorError, RunError
from cnca.core.images import read_texture_srgb
from cnca.core.manifest import read_json, write_json
from cnca.core.types import SrgbTexture
from cnca.judge.candidates import Candidate, parse_candidates
from cnca.judge.style import SHIPPED_JUDGE, TEN_PROMPTS, StyleJudge


@dataclass(frozen=True)
class StyleVerdict:
    """What the judge says of one texture."""

    texture: str
    asked: str | None
    """The prompt of the run that found it, where there is such a run."""
    shares: dict[str, float]
    """How likely it shows each prompt, in [0, 1]; they sum to 1."""

    @property
    def ranked(self) -> list[tuple[str, float]]:
        """Prompts and shares, the likeliest first."""
        return sorted(self.shares.items(), key=lambda pair: -pair[1])

    @property
    def right(self) -> bool | None:
        """Whether the likeliest prompt is the one that was asked for; None without one."""
        return None if self.asked is None else self.ranked[0][0] == self.asked


def judge_style(
    textures: Sequence[str],
    *,
    prompts: Sequence[str] = TEN_PROMPTS,
    weights: Path = SHIPPED_JUDGE,
    out: Path | None = None,
) -> list[StyleVerdict]:
    """Judge textures as ``cnca evaluate`` takes them, and write ``out`` as JSON if it is given.

    A prompt that a run asked for, and that is not among ``prompts``, is put beside them.

    Raises:
        GeneratorError: a prompt without a pattern that the judge knows, or fewer than two prompts.
        TextureError: a texture that cannot be read.
    """
    candidates = parse_candidates(textures)
    asked = [asked_for(candidate) for candidate in candidates]
    choices = list(dict.fromkeys([*prompts, *(prompt for prompt in asked if prompt)]))
    if len(choices) < 2:
        raise GeneratorError(f"--prompt {', '.join(choices)}: a judge needs two or more to choose")
    judge = StyleJudge.load(weights)
    verdicts = []
    for candidate, prompt in zip(candidates, asked, strict=True):
        texture = torch.from_numpy(read_texture_srgb(candidate.picture)).permute(2, 0, 1)
        shares = judge.judge(SrgbTexture(texture), choices).tolist()
        by_prompt = {name: round(s, 4) for name, s in zip(choices, shares, strict=True)}
        verdicts.append(StyleVerdict(candidate.name, prompt, by_prompt))
    if out:
        write_json(out, {"textures": [asdict(v) | {"right": v.right} for v in verdicts]})
    return verdicts


def asked_for(candidate: Candidate) -> str | None:
    """The prompt of the run that found a texture; raises RunError where its summary is damaged."""
    summary = candidate.picture.parent / "summary.json"
    if not summary.is_file():
        return None
    prompt = read_json(summary).get("prompt")
    if prompt is not None and not isinstance(prompt, str):
        raise RunError(f"{summary}: prompt is {prompt!r}, must be text; make the run anew")
    return prompt
