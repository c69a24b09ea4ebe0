"""Pictures and detections kept as files, each with a key to everything that it was made from.

So a rerun goes on where it was interrupted, another detector looks at pictures that are there, and
whatever has changed since is made anew.
"""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path, PurePath

import numpy as np
import torch
from pydantic import BaseModel
from torch import Tensor

from cnca.core.files import replacing
from cnca.core.types import Detections, SrgbImages

Arrays = Mapping[str, np.ndarray]


def digest(*things: object) -> str:
    """SHA-256 of things by their content, records and collections by that of their parts.

    Raises TypeError for what has no content that could be told, such as a function: its ``repr`` is
    an address, which says nothing of what it does.
    """
    state = hashlib.sha256()
    for thing in things:
        _feed(state, thing)
    return state.hexdigest()


def _feed(state: hashlib._Hash, thing: object) -> None:
    """Add one thing; every part ends so that no other parts read the same."""
    if isinstance(thing, Tensor):
        thing = thing.detach().cpu().numpy()
    if isinstance(thing, np.ndarray):
        state.update(repr((thing.dtype, thing.shape)).encode())
        state.update(np.ascontiguousarray(thing).tobytes())
    elif isinstance(thing, bytes):
        state.update(repr(len(thing)).encode() + thing)
    elif isinstance(thing, BaseModel):
        _feed(state, (type(thing).__name__, thing.model_dump()))
    elif is_dataclass(thing) and not isinstance(thing, type):
        _feed(state, type(thing).__name__)
        _feed(state, {f.name: getattr(thing, f.name) for f in fields(thing)})
    elif isinstance(thing, Mapping):
        _feed(state, list(thing.items()))
    elif isinstance(thing, list | tuple):
        state.update(f"[{len(thing)}".encode())
        for part in thing:
            _feed(state, part)
    elif thing is None or isinstance(thing, str | int | float | PurePath | np.generic):
        state.update(repr(thing).encode())
    else:
        raise TypeError(f"a {type(thing).__name__} has no content to tell it by")
    state.update(b"\0")


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

    return SrgbImages(torch.from_numpy(recall(path, key, make)["pictures"]).float() / 255)


def kept_detections(path: Path, key: str, look: Callable[[], list[Detections]]) -> list[Detections]:
    """The detections of several images."""

    def make() -> Arrays:
        detections = look()
        return {
            "counts": np.array([len(image.scores) for image in detections], np.int64),
            "boxes": torch.cat([image.boxes for image in detections]).float().cpu().numpy(),
            "scores": torch.cat([image.scores for image in detections]).float().cpu().numpy(),
            "labels": torch.cat([image.labels for image in detections]).long().cpu().numpy(),
        }

    arrays = recall(path, key, make)
    counts = arrays["counts"].tolist()
    columns = (torch.from_numpy(arrays[name]) for name in ("boxes", "scores", "labels"))
    parts = zip(*(column.split(counts) for column in columns), strict=True)
    return [Detections(*part) for part in parts]
