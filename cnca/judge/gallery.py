"""Pictures and detections kept as files, each with a key to everything that it was made from.

So a rerun goes on where it was interrupted, another detector looks at pictures that are there, and
whatever has changed since is made anew.
"""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from cnca.core.files import replacing
from cnca.core.types import Detections, SrgbImages

Arrays = Mapping[str, np.ndarray]


def digest(*things: object) -> str:
    """SHA-256 of tensors, arrays and bytes by content, and of all else by ``repr``."""
    state = hashlib.sha256()
    for thing in things:
        if isinstance(thing, Tensor):
            thing = thing.detach().cpu().numpy()
        if isinstance(thing, np.ndarray):
            state.update(repr((thing.dtype, thing.shape)).encode())
            state.update(np.ascontiguousarray(thing).tobytes())
        else:
            state.update(thing if isinstance(thing, bytes) else repr(thing).encode())
        state.update(b"\0")
    return state.hexdigest()


def recall(path: Path, key: str, make: Callable[[], Arrays]) -> Arrays:
    """The arrays in the ``.npz`` at ``path`` where it was made for ``key``; else made and stored.

    A file that is damaged counts as missing.
    """
    if path.exists():
        try:
            with np.load(path, allow_pickle=False) as stored:
                if str(stored["key"]) == key:
                    return {name: stored[name] for name in stored.files if name != "key"}
        except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile):
            pass
    arrays = make()
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, key=np.array(key), **arrays)  # type: ignore[arg-type]
    return arrays


def kept_pictures(path: Path, key: str, take: Callable[[], SrgbImages]) -> SrgbImages:
    """Pictures of 8 bits, as :func:`cnca.judge.evaluate.photograph` takes them."""

    def make() -> Arrays:
        return {"pictures": (take() * 255).round().byte().cpu().numpy()}

    return torch.from_numpy(recall(path, key, make)["pictures"]).float() / 255


def kept_detections(path: Path, key: str, look: Callable[[], list[Detections]]) -> list[Detections]:
    """The detections of several images."""

    def make() -> Arrays:
        found = look()
        return {
            "counts": np.array([len(each.scores) for each in found], np.int64),
            "boxes": torch.cat([each.boxes for each in found]).float().cpu().numpy(),
            "scores": torch.cat([each.scores for each in found]).float().cpu().numpy(),
            "labels": torch.cat([each.labels for each in found]).long().cpu().numpy(),
        }

    arrays = recall(path, key, make)
    counts = arrays["counts"].tolist()
    columns = (torch.from_numpy(arrays[name]) for name in ("boxes", "scores", "labels"))
    parts = zip(*(column.split(counts) for column in columns), strict=True)
    return [Detections(*part) for part in parts]
