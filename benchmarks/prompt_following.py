"""How often a scorer picks a generator's prompt out of ten: held-out prompts, without F_adv.

Prompts are captions of the kind that ``cnca train-generator`` learns, drawn anew; those of the
corpus and the paper's own are left out, the latter are shown on the contact sheet.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import torch

from cnca.core.pictures import write_png
from cnca.gen import GUIDANCE, textures
from cnca.gen.contact_sheet import contact_sheet
from cnca.gen.sampling import DiffusionTextureGenerator
from cnca.gen.scorer import load_scorer, right_prompts

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--generator", type=Path, help="folder in diffusers format")
parser.add_argument("--scorer", type=Path, help="file of train-scorer, or a CLIP folder")
parser.add_argument("--corpus", type=Path, default=Path("out/generator/captions-4096-0.json"))
parser.add_argument("--guidance", type=float, default=GUIDANCE)
parser.add_argument("--prompts", type=int, default=60)
parser.add_argument("--seed", type=int, default=1)
parser.add_argument("--sheet", type=Path, help="contact sheet of the paper's prompts to write")
arguments = parser.parse_args()

generator = DiffusionTextureGenerator.load(arguments.generator, guidance=arguments.guidance)
scorer = load_scorer(arguments.scorer)
known = set(json.loads(arguments.corpus.read_text())) if arguments.corpus.exists() else set()
prompts: list[str] = []
index = 0
while len(prompts) < arguments.prompts:
    caption = textures.sample(np.random.default_rng([arguments.seed, 0, index])).caption
    if caption not in known and caption not in prompts:
        prompts.append(caption)
    index += 1


def paint(prompt: str, seed: int) -> torch.Tensor:
    """The texture of a prompt from the noise of ``seed``, without F_adv."""
    with torch.no_grad():
        noise = torch.Generator().manual_seed(seed)
        return generator.generate(generator.encode(prompt), None, noise)


pictures = torch.stack([paint(prompt, seed) for seed, prompt in enumerate(prompts)])
hits = right_prompts(scorer, pictures, prompts, choices=10, seed=arguments.seed)
rate = sum(hits) / len(hits)
error = (rate * (1 - rate) / len(hits)) ** 0.5
print(f"right prompt of ten: {rate:.1%} ± {error:.1%} of {len(hits)} held-out prompts")
print("missed:", ", ".join(p for p, hit in zip(prompts, hits, strict=True) if not hit))
if arguments.sheet:
    write_png(arguments.sheet, contact_sheet(generator, textures.PAPER_PROMPTS, (0, 1)))
