"""A world put together of several files, such as the houses and tiles of a kit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cnca.core.errors import MeshError
from cnca.world.model import Lamp, Piece, Place, Surface, World


def placed(world: World, place: Place) -> World:
    """The world turned by the place's heading and moved to it: the reverse of ``around``."""
    back = world.around(Place(0.0, 0.0, 0.0, -place.heading))
    foot = np.array([place.x, place.y, place.z])
    pieces = tuple(replace(piece, vertices=piece.vertices + foot) for piece in back.pieces)
    lamps = tuple(
        replace(lamp, position=tuple((np.array(lamp.position) + foot).tolist()))
        for lamp in back.lamps
    )
    return replace(back, pieces=pieces, lamps=lamps)


def composed(name: str, worlds: Sequence[World]) -> World:
    """All of them as one; its places are those of the first.

    Raises MeshError for a scene in Mitsuba's XML, whose parts only Mitsuba can join.
    """
    pieces: list[Piece] = []
    surfaces: dict[str, Surface] = {}
    lamps: list[Lamp] = []
    source: dict[str, str] = {}
    for number, world in enumerate(worlds):
        if world.xml is not None:
            raise MeshError(f"{name}: an XML scene has no parts; <include> them in the scene")
        # Worlds of one file share their surfaces, and so their materials when rendered.
        key = next((k for k, w in enumerate(worlds) if w.source == world.source), number)
        surfaces |= {f"{key}/{surface}": world.surfaces[surface] for surface in world.surfaces}
        pieces += [replace(piece, surface=f"{key}/{piece.surface}") for piece in world.pieces]
        lamps += world.lamps
        source |= world.source
    first = worlds[0]
    return World(
        name, tuple(pieces), surfaces, places=first.places, lamps=tuple(lamps), source=source
    )
