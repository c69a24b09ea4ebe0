"""The training set: captioned textures in two files, written once and then mapped into memory."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cnca.core.files import write_text
from cnca.core.progress import track
from cnca.gen import patterns, textures


@dataclass(frozen=True)
class Corpus:
    """Pictures (count, 256, 256, 3), sRGB as uint8, and one caption for each."""

    pictures: np.ndarray
    captions: list[str]


def prepare(folder: Path, *, count: int, seed: int) -> Corpus:
    """Return the corpus in ``folder``, painting it first unless it is there already."""
    pictures, captions = (
        folder / f"pictures-{count}-{seed}.npy",
        folder / f"captions-{count}-{seed}.json",
    )
    if not captions.exists():
        _paint(pictures, captions, count, seed)
    return Corpus(np.load(pictures, mmap_mode="r"), json.loads(captions.read_text()))


def _paint(pictures: Path, captions: Path, count: int, seed: int) -> None:
    """Write the captions last: their presence says that the pictures are complete."""
    pictures.parent.mkdir(parents=True, exist_ok=True)
    shape = (count, patterns.SIZE, patterns.SIZE, 3)
    canvas = np.lib.format.open_memmap(pictures, mode="w+", dtype=np.uint8, shape=shape)
    words = []
    for i in track(range(count), "painting textures"):
        # one stream per picture, so that the first n pictures do not depend on the count
        texture = textures.sample(np.random.default_rng([seed, i]))
        canvas[i] = np.rint(255.0 * np.clip(texture.picture, 0.0, 1.0))
        words.append(texture.caption)
    canvas.flush()
    write_text(captions, json.dumps(words))
