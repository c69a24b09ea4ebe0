"""How often the judge of style names the prompt of textures that the shipped generator makes.

    python benchmarks/style_judge.py --out out/style_judge_test

Ten prompts, F_adv = 0, noises that no training took; the shipped scorer, which is another network
and may be in a loss, chooses beside it.  Pictures that ``--out`` holds already are kept.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import torch
from tables import markdown

from cnca.core.images import read_texture_srgb, write_texture_srgb
from cnca.core.manifest import write_json
from cnca.core.types import SrgbTexture
from cnca.gen.sampling import DiffusionTextureGenerator
from cnca.gen.scorer import load_scorer
from cnca.judge.style import TEN_PROMPTS, StyleJudge

FIRST_SEED = 5_000


def painted(out: Path, size: int, seeds: int) -> dict[str, list[SrgbTexture]]:
    """Prompt → its textures of ``size``², made unless they are there."""
    generator = DiffusionTextureGenerator.load(size=size)
    none = torch.zeros(generator.feature_shape)
    textures: dict[str, list[SrgbTexture]] = {prompt: [] for prompt in TEN_PROMPTS}
    for seed in range(seeds):
        for prompt, made in textures.items():
            file = out / f"{prompt.replace(' ', '_')}-{size}-{seed}.png"
            if not file.exists():
                noise = torch.Generator().manual_seed(FIRST_SEED + seed)
                with torch.no_grad():
                    texture = generator.generate(generator.encode(prompt), none, noise)
                write_texture_srgb(file, texture.permute(1, 2, 0).numpy())
            made.append(torch.from_numpy(read_texture_srgb(file)).permute(2, 0, 1))
    return textures


def named(shares: Sequence[torch.Tensor]) -> list[str]:
    """The prompt that each row of shares or cosines likes best."""
    return [TEN_PROMPTS[int(row.argmax())] for row in shares]


def main() -> None:
    """Paint, judge, print a table for each size and write all answers as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/style_judge_test"))
    parser.add_argument("--judge", type=Path, help="file of train-style-judge, by default ours")
    parser.add_argument("--seeds", type=int, nargs=2, default=(5, 1), help="for 256² and 512²")
    options = parser.parse_args()
    judge = StyleJudge.load(options.judge) if options.judge else StyleJudge.load()
    scorer, answers = load_scorer(), {}
    for size, seeds in zip((256, 512), options.seeds, strict=True):
        rows, right = [], 0
        for prompt, textures in painted(options.out, size, seeds).items():
            judged = named([judge.judge(texture, TEN_PROMPTS) for texture in textures])
            scored = named(list(scorer.score(torch.stack(textures), TEN_PROMPTS)))
            hits = [judged.count(prompt), scored.count(prompt)]
            others = ", ".join(sorted({name for name in judged if name != prompt})) or "–"
            rows.append([prompt, *(f"{hit} of {seeds}" for hit in hits), others])
            right += hits[0]
            answers[f"{prompt}, {size}"] = judged
        print("\n".join(markdown((f"{size}²", "judge", "scorer", "judge's mistakes"), rows)))
        print(f"\njudge: {right} of {seeds * len(TEN_PROMPTS)}\n")
    write_json(options.out / "answers.json", answers)


if __name__ == "__main__":
    main()
