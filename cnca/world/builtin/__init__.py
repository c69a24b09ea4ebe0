"""Worlds of our own, made from a seed: registered here under the names that scene files use."""

from __future__ import annotations

from collections.abc import Callable

from cnca.core.errors import MeshError, did_you_mean
from cnca.world.model import World

BUILTIN_WORLDS: dict[str, Callable[[int], World]] = {}
"""Name after ``builtin:`` → what makes that world from a seed."""


def build(name: str, seed: int) -> World:
    """The built-in world of that name; raises MeshError where there is none."""
    if name not in BUILTIN_WORLDS:
        known = ", ".join(f"builtin:{known}" for known in BUILTIN_WORLDS) or "none yet"
        hint = did_you_mean(name, BUILTIN_WORLDS)
        raise MeshError(f"builtin:{name}: no such built-in world (there are {known}){hint}")
    return BUILTIN_WORLDS[name](seed)
