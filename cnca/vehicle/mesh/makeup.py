"""What a mesh is made of: which material is paint, by its name and by what is seen of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from cnca.core.images import read_mask
from cnca.scene.schema import VehicleSection
from cnca.vehicle.mesh.finding import Finding, listed
from cnca.vehicle.mesh.names import known_material
from cnca.vehicle.mesh.pieces import Piece
from cnca.vehicle.mesh.sight import Sight
from cnca.vehicle.uv.rebake import shown_in

WORTH_A_WORD = 0.01
"""Share of what is seen below which nothing is said."""
LEAST_PAINT, LITTLE_PAINT = 0.02, 0.2
"""Shares of what is seen below which there is no paint, or probably another material is it."""
EXPECTED = ("glass", "tyre", "light")
"""Kinds of material whose absence says that the file's names were not understood."""


def check_materials(
    pieces: Sequence[Piece], section: VehicleSection, sight: Sight, base: Path
) -> Iterator[Finding]:
    """Raises TextureError where the section's mask cannot be read."""
    kinds = {piece.material: piece.kind for piece in pieces}
    seen = {name: sight.share(np.isin(sight.piece, _of(pieces, [name]))) for name in kinds}
    for kind in sorted(set(kinds.values())):
        named = [name for name, own in kinds.items() if own == kind]
        share = f"{sum(seen[name] for name in named):.1%} of what is seen: {listed(named)}"
        yield Finding("note", f"looks like {kind}", share)
    if len(kinds) == 1:
        if not section.paint_mask:
            number = "a single one; glass, lights and tyres would be painted, too"
            yield Finding("warning", "materials", number, "draw a vehicle.paint_mask")
    else:
        yield from _which_is_what(pieces, section, kinds, seen)
    painted = _painted(pieces, section, sight, base)
    if "paint" in kinds.values() and painted < LEAST_PAINT and _paint_share(kinds, seen) >= LEAST_PAINT:  # fmt: skip  # noqa: E501
        number = f"{painted:.1%} of what is seen is paint inside the mask"
        yield Finding("fault", "paint_mask", number, "white is paint, black is none; check its UVs")


def _which_is_what(
    pieces: Sequence[Piece],
    section: VehicleSection,
    kinds: Mapping[str, str],
    seen: Mapping[str, float],
) -> Iterator[Finding]:
    silent = [
        name
        for name in kinds
        if known_material(name) is None and name not in section.materials
        if seen[name] > WORTH_A_WORD
    ]
    proposed = _by_part_names(pieces, [name for name in silent if kinds[name] == "trim"])
    share = _paint_share({**kinds, **proposed}, seen)
    body = _body({**kinds, **proposed}, [name for name in silent if name not in proposed], seen)
    if share < LEAST_PAINT:
        hidden = {name: "trim" for name, kind in kinds.items() if kind == "paint"}
        proposed = hidden | proposed | {body: "paint"}
        number = f"{share:.1%} of what is seen is paint; most of it is {body}"
        yield Finding("fault", "materials", number, keys={"materials": proposed})
    elif share < LITTLE_PAINT and kinds.get(body) == "trim" and seen[body] > 2 * share:
        number = f"{share:.1%} of what is seen is paint, but {seen[body]:.1%} is {body}"
        keys = {"materials": proposed | {body: "paint"}}
        yield Finding("warning", "materials", number, "a guess", keys)
        proposed = {**proposed, body: "paint"}
    elif proposed:
        number = f"dark trim, but their parts are named otherwise: {listed(proposed)}"
        yield Finding("warning", "materials", number, keys={"materials": proposed})
    guessed = [name for name in silent if kinds[name] == "paint"]
    if guessed and share >= LEAST_PAINT:
        number = f"{listed(guessed)} is taken as paint: no other name is unknown"
        yield Finding("note", "materials", number, "else name it in vehicle.materials")
    missing = [kind for kind in EXPECTED if kind not in {*kinds.values(), *proposed.values()}]
    if missing:
        trim = [name for name in silent if name not in {**proposed, body: ""}]
        number = f"none is known as {', '.join(missing)}; dark trim: {listed(trim) or 'none'}"
        yield Finding("warning", "materials", number, "name them in vehicle.materials")


def _body(kinds: Mapping[str, str], silent: Sequence[str], seen: Mapping[str, float]) -> str:
    """The material that is seen most: among those with silent names, else trim, else any."""
    trim = [name for name, kind in kinds.items() if kind == "trim" and seen[name] > WORTH_A_WORD]
    return max(silent or trim or list(kinds), key=lambda name: seen[name])


def _paint_share(kinds: Mapping[str, str], seen: Mapping[str, float]) -> float:
    return sum(seen[name] for name, kind in kinds.items() if kind == "paint")


def _painted(pieces: Sequence[Piece], section: VehicleSection, sight: Sight, base: Path) -> float:
    """Share of what is seen that is paint, by the mask too where it is drawn in the file's UVs."""
    paint = np.isin(sight.piece, [k for k, piece in enumerate(pieces) if piece.kind == "paint"])
    if section.paint_mask is None or section.unwrap:
        return sight.share(paint)
    mask = read_mask(base / section.paint_mask)
    for k, piece in enumerate(pieces):
        if piece.kind == "paint" and piece.uvs is not None:
            points = sight.piece == k
            paint[points] = _inside(mask, piece, sight.face[points])
    return sight.share(paint)


def _inside(
    mask: Bool[np.ndarray, "height width"], piece: Piece, faces: np.ndarray
) -> Bool[np.ndarray, " points"]:
    assert piece.uvs is not None
    return shown_in(mask, np.nan_to_num(piece.uvs[piece.faces[faces]]))


def _of(pieces: Sequence[Piece], materials: Collection[str]) -> list[int]:
    return [k for k, piece in enumerate(pieces) if piece.material in materials]


def _by_part_names(pieces: Sequence[Piece], materials: Sequence[str]) -> dict[str, str]:
    """What the names of the parts say of materials whose own names say nothing."""
    found = {}
    for material in materials:
        parts = [piece for piece in pieces if piece.material == material]
        names = [name for piece in parts for name in piece.groups or (piece.name,)]
        votes = Counter(known_material(name) for name in names)
        if len(votes) == 1 and (kind := next(iter(votes))) not in (None, "trim"):
            found[material] = str(kind)
    return found
