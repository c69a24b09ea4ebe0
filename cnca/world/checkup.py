"""What stands between a world's file and a vehicle in it, and which keys mend it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from cnca.core.errors import SceneError
from cnca.world.mitsuba_xml import MitsubaXml
from cnca.world.model import Piece, World
from cnca.world.reading import read_world
from cnca.world.resolve import load_file
from cnca.world.stand import bounds, ground_under

SMALLEST, LARGEST = 10.0, 5000.0
"""Metres: sides of the ground plan between which a world's scale is believed."""
FREE = 2.5
"""Metres around a place in which nothing may stand."""
TRIES = 400
PLACES = 3


@dataclass(frozen=True)
class WorldCheckup:
    """What there is to say about a world."""

    findings: tuple[str, ...]
    section: Mapping[str, object]
    """The scene's ``world`` section with the keys that mend what keys can mend."""
    usable: bool
    """Whether a vehicle can stand in it."""


def check_world(path: Path, *, up: str | None = None, scale: float = 1.0) -> WorldCheckup:
    """Read a world and say what is wrong with it.

    Raises MeshError where the file cannot be read at all.
    """
    world = load_file(path, up=up, scale=scale)
    findings = _of_mesh(path) if world.xml is None else _of_xml(world.xml)
    section: dict[str, object] = {"file": str(path)}
    section |= ({"up": up} if up else {}) | ({"scale": scale} if scale != 1 else {})
    low, high = bounds(world)
    width = float((high - low)[:2].max())
    findings.append(f"note     spans {' × '.join(f'{side:.1f}' for side in high - low)} m")
    if not SMALLEST <= width <= LARGEST:
        findings.append(
            f"warning  {width:.4g} m wide is no street → world.scale: metres per unit of the file, "
            "such as 0.01 for centimetres or 0.0254 for inches"
        )
    level = [_level_area(world, axis) for axis in range(3)]
    if level[2] < max(level) / 2:
        findings.append("warning  most level ground does not look up → world.up: x, y or z")
    places = list(free_places(world))
    if places:
        x, y = places[0]
        section["at"] = [x, y]
        others = ", ".join(f"[{x:g}, {y:g}]" for x, y in places)
        findings.append(f"note     a vehicle can stand at {others} → world.at")
    else:
        findings.append("error    nowhere is there free, level ground → check world.scale and up")
    return WorldCheckup(tuple(findings), section, bool(places))


def _of_mesh(path: Path) -> list[str]:
    """What there is to say about the pictures of a mesh file."""
    reading = read_world(path)
    findings = [f"note     picture {name}: lies at {file}" for name, file in reading.moved.items()]
    return findings + [
        f"warning  {name}: lies nowhere near; its surface is grey → put it beside the file"
        for name in dict.fromkeys(reading.missing)
    ]


def _of_xml(xml: MitsubaXml) -> list[str]:
    """What of a scene of Mitsuba's is left out, and whether it shines."""
    findings = [f"note     {kind}: left out, ours is taken" for kind in xml.ignored]
    if xml.lamps:
        findings.append(f"note     {xml.lamps} lamps: on at night, or always by world.lamps: on")
    return findings


def _level_area(world: World, axis: int) -> float:
    return sum(float(np.abs(_crosses(piece)[:, axis]).sum()) for piece in world.pieces)


def _crosses(piece: Piece) -> Float[np.ndarray, "faces 3"]:
    a, b, c = np.moveaxis(piece.vertices[piece.faces], 1, 0)
    return np.cross(b - a, c - a)


def free_places(world: World) -> Iterator[tuple[float, float]]:
    """Up to :data:`PLACES` points on ground that is level and free for a car's length around.

    Points are drawn by area from surfaces that look up.
    """
    rng = np.random.default_rng(0)
    triangles = np.concatenate([piece.vertices[piece.faces] for piece in world.pieces])
    area = np.concatenate([_crosses(piece)[:, 2].clip(min=0) for piece in world.pieces])
    if not area.sum() > 0:
        return
    count = 0
    for face in rng.choice(len(area), TRIES, p=area / area.sum()):
        x, y = (rng.dirichlet(np.ones(3)) @ triangles[face])[:2].round(1).tolist()
        if _is_free(world, x, y):
            yield x, y
            count += 1
        if count == PLACES:
            return


def _is_free(world: World, x: float, y: float) -> bool:
    try:
        heights = [
            ground_under(world, x + dx, y + dy)
            for dx in (-FREE, 0, FREE)
            for dy in (-FREE, 0, FREE)
        ]
    except SceneError:
        return False
    low, high = min(heights), max(heights)
    if high - low > 0.05:
        return False
    for piece in world.pieces:
        corners = piece.vertices[piece.faces]
        near = (corners.min(axis=1) < [x + FREE, y + FREE, low + 2.0]).all(axis=1)
        near &= (corners.max(axis=1) > [x - FREE, y - FREE, low + 0.3]).all(axis=1)
        if near.any():
            return False
    return True
