"""The world that a scene file names, moved around the vehicle."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from cnca.core.errors import MeshError, SceneError
from cnca.scene.cameras import Spot
from cnca.scene.schema import WorldSection
from cnca.world.compose import composed, placed
from cnca.world.model import Place, World
from cnca.world.sight import Sight
from cnca.world.stand import ground_under

BUILTIN = "builtin:"


WORLDS_KEPT = 4
"""Worlds whose arrays stay in memory."""


def world_at(section: WorldSection, base: Path, spot: Spot) -> World:
    """The world moved so that the spot is the origin and the vehicle there faces +x.

    Raises as :func:`resolve_world` does, and SceneError where something stands in the vehicle.
    """
    world = resolve_world(section, base, spot.seed)
    chosen, *others = world.places
    if spot.place is not None and others:
        chosen = others[int(spot.place * len(others))]
    moved = world.around(chosen)
    if not Sight(moved).is_free():
        raise SceneError(
            f"world: something of {world.name} stands inside the vehicle at ({chosen.x:g}, "
            f"{chosen.y:g}); move it by world.at, `cnca check-world` names free places"
        )
    return moved


@lru_cache(maxsize=WORLDS_KEPT)
def resolve_world(section: WorldSection, base: Path, seed: int = 0) -> World:
    """The world in its own axes; its first place is where the section puts the vehicle.

    The others are those that it knows, or that the section lists.

    Args:
        base: the folder that the file's path starts from.
        seed: added to the section's: another form of a built-in world.

    Raises:
        MeshError: the file cannot be used, or there is no built-in world of that name.
        SceneError: the world has no such place.
    """
    if section.file.startswith(BUILTIN):
        from cnca.world.builtin import build

        world = build(section.file.removeprefix(BUILTIN), section.seed + seed)
    else:
        world = _from_file(section, base)
    listed = [Place(x, y, ground_under(world, x, y), heading) for x, y, heading in section.places]
    known = listed if listed or not section.file.startswith(BUILTIN) else world.places
    return replace(world, places=(_chosen(section, world), *known))


def _from_file(section: WorldSection, base: Path) -> World:
    path = base / section.file
    if section.missing and not path.exists():
        raise MeshError(f"{path}: no such file; {section.missing}")
    world = load_file(path, up=section.up, scale=section.scale)
    if not section.parts:
        return world
    kinds = {
        name: load_file(base / name, up=section.up, scale=section.scale)
        for name in dict.fromkeys(part.file for part in section.parts)
    }
    parts = []
    for part in section.parts:
        x, y, *height = part.at
        place = Place(x, y, height[0] if height else 0.0, part.heading)
        parts.append(placed(kinds[part.file], place))
    return composed(path.stem, [world, *parts])


def load_file(path: Path, *, up: str | None, scale: float) -> World:
    """A mesh, or a scene in Mitsuba's XML; raises MeshError for what is neither."""
    if path.suffix.lower() == ".xml":
        from cnca.world.xml_world import load_xml_world

        return load_xml_world(path, up=up, scale=scale)
    from cnca.world.mesh import load_world

    return load_world(path, up=up, scale=scale)


def _chosen(section: WorldSection, world: World) -> Place:
    if section.at is None:
        if section.place >= len(world.places):
            raise SceneError(
                f"world.place: {section.file} has {len(world.places)} places, numbered from 0 "
                f"(got {section.place})"
            )
        place = world.places[section.place]
    else:
        x, y, *height = section.at
        place = Place(x, y, height[0] if height else ground_under(world, x, y))
    return place if section.heading is None else replace(place, heading=section.heading)
