"""How a mesh stands: axes, size and place, and the scene's keys that put them right."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from cnca.scene.schema import VehicleSection
from cnca.vehicle.mesh.finding import Finding, Severity
from cnca.vehicle.mesh.names import words
from cnca.vehicle.mesh.pieces import Piece
from cnca.vehicle.mesh.place import misplaced
from cnca.vehicle.mesh.posture import posture
from cnca.vehicle.mesh.size import (
    CAR,
    CAR_LENGTH,
    LONGEST,
    SHORTEST,
    USUAL_LENGTH,
    Size,
    guess_scale,
    is_car,
    is_long_vehicle,
)


def check_axes(pieces: Sequence[Piece], section: VehicleSection) -> Iterator[Finding]:
    """``pieces`` are as the file has them."""
    found = posture(pieces, section.up, section.front)
    if found.up != section.up or found.front[1] != section.front[1]:
        keys = {"up": found.up, "front": found.front}
        number = f"up {section.up} and front {section.front} do not fit the shape"
        yield Finding("fault", "axes", number, keys=keys)
    elif found.front != section.front:
        number = f"front is {section.front}, but the lights or the roof look to {found.front}"
        yield Finding("warning", "axes", number, keys={"front": found.front})
    else:
        yield Finding("note", "axes", f"up {section.up} and front {section.front} fit the shape")
    if found.upside_down:
        number = "upside down: the roof is longer than the floor"
        yield Finding("fault", "axes", number, "turn it over in the modelling program")
    spans = np.ptp(np.concatenate([p.vertices[np.unique(p.faces)] for p in pieces]), axis=0)
    length, height = (float(spans["xyz".index(axis)]) for axis in (found.front[1], found.up))
    yield _size((length, float(spans.sum()) - length - height, height), section)


def _size(units: Size, section: VehicleSection) -> Finding:
    """``units`` are length, width and height in the file's units."""
    metres = (section.scale * units[0], section.scale * units[1], section.scale * units[2])
    size = " × ".join(f"{side:.3g}" for side in metres) + " m"
    if is_car(metres):
        return Finding("note", "size", size)
    if is_long_vehicle(metres):
        return _long(size, section)
    scale, unit = guess_scale(units, section.label)
    severity: Severity = "warning" if SHORTEST <= metres[0] <= LONGEST else "fault"
    number = f"{size}; cars are {CAR_LENGTH[0]:g} to {CAR_LENGTH[1]:g} m long"
    long = is_long_vehicle((scale * units[0], scale * units[1], scale * units[2]))
    keys = dict(_long(size, section).keys) if long else {}
    return Finding(severity, "size", number, unit, {"scale": scale, **keys})


def _long(size: str, section: VehicleSection) -> Finding:
    """Buses and trucks keep their length; detectors are to find them as what they are."""
    if section.label != CAR:
        return Finding("note", "size", size)
    named = words(Path(section.mesh).stem)
    label = next((label for label in USUAL_LENGTH if label in named), None)
    if label:
        number = f"{size}: a {label} by its name and length, but its label is {section.label}"
        return Finding("warning", "size", number, keys={"label": label})
    return Finding("note", "size", f"{size}: that of a bus or truck", "say so by vehicle.label")


def check_place(pieces: Sequence[Piece], section: VehicleSection) -> Iterator[Finding]:
    """``pieces`` are in our axes and metres."""
    points = np.concatenate([p.vertices[np.unique(p.faces)] for p in pieces])
    offset = misplaced(points.min(axis=0), points.max(axis=0))
    if not offset.any():
        return
    number = f"the middle is {np.linalg.norm(offset):.3g} m from the origin"
    if section.recentre:
        yield Finding("note", "place", number, "moved onto it; vehicle.recentre: false keeps it")
    else:
        yield Finding("warning", "place", number, "cameras look at the origin", {"recentre": True})
