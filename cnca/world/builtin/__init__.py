"""Worlds of our own, made by formulas and a seed: streets, car parks, country roads."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cnca.core.errors import MeshError, SceneError, did_you_mean
from cnca.world.builtin.car_park import build as car_park
from cnca.world.builtin.country_road import build as country_road
from cnca.world.builtin.crossing import build as crossing
from cnca.world.builtin.street import build as street
from cnca.world.model import World

BUILTIN_WORLDS: dict[str, Callable[[np.random.Generator], World]] = {
    "street": street,
    "crossing": crossing,
    "car_park": car_park,
    "country_road": country_road,
}
"""Builders by name; scenes call them ``builtin:street`` and so on."""


def build(name: str, seed: int) -> World:
    """The built-in world ``name`` (without ``builtin:``); the same seed gives the same world.

    Raises:
        MeshError: there is no built-in world of that name.
        SceneError: a negative seed.
    """
    if name not in BUILTIN_WORLDS:
        known = ", ".join(f"builtin:{known}" for known in BUILTIN_WORLDS)
        hint = did_you_mean(name, BUILTIN_WORLDS)
        raise MeshError(f"builtin:{name}: no such built-in world (there are {known}){hint}")
    if seed < 0:
        raise SceneError(f"builtin:{name}: seed {seed}: give a whole number from 0 upwards")
    return BUILTIN_WORLDS[name](np.random.default_rng(seed))
