"""What stands between a mesh and an attack on it: one finding for each thing that was looked at."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from cnca.core.errors import MeshError
from cnca.core.images import read_mask
from cnca.scene.schema import VehicleSection
from cnca.vehicle.mesh.load_mesh import BUILTIN, guess_material, resolve_vehicle
from cnca.vehicle.mesh.pieces import OURS, Piece, read_pieces, sound, turned
from cnca.vehicle.mesh.posture import CAR_LENGTH, guess_scale, posture
from cnca.vehicle.mesh.sight import Sight, look_around
from cnca.vehicle.mesh.surface import face_crosses
from cnca.vehicle.uv.uv_checkup import measure_uvs

Severity = Literal["fault", "warning", "note"]
"""A fault stops an attack or makes its numbers meaningless; a warning makes it weaker or ugly."""
LONGEST = 18.75
"""Metres: the longest road vehicle (European directive 96/53/EC, annex I)."""
SHORTEST = 2.0
WORTH_A_WORD = 0.01
"""Share of what is seen, or of the texture, below which nothing is said."""
SPREAD = 4.0
"""Texels per metre, 95th over 5th percentile: one part is that much blurrier than another."""
EXPECTED = ("glass", "tyre", "light")
"""Kinds of material whose lack says that the file's names were not understood."""
RECALCULATE = "recalculate normals outside in the modelling program"


@dataclass(frozen=True)
class Finding:
    """One line of a checkup."""

    severity: Severity
    what: str
    number: str
    mend: str = ""
    """The command that mends it, or what to do elsewhere."""
    keys: Mapping[str, object] = field(default_factory=dict)
    """Keys of the scene's vehicle section that mend it."""

    def line(self) -> str:
        """Severity, what, number and remedy."""
        keys = [f"vehicle.{key}: {as_yaml(value)}" for key, value in self.keys.items()]
        mend = "; ".join([", ".join(keys)] * bool(keys) + [self.mend] * bool(self.mend))
        return f"{self.severity:8}{self.what}: {self.number}" + (f" → {mend}" if mend else "")


def check(section: VehicleSection, base: Path) -> list[Finding]:
    """Everything that there is to say about a scene's vehicle, the worst first.

    Raises MeshError where the file cannot be read at all, TextureError where its mask cannot.
    """
    raw = read_pieces(section, base)
    if section.mesh.startswith(BUILTIN):
        section = section.model_copy(update=OURS)
    findings = list(_triangles(raw))
    pieces = sound(raw)
    if pieces:
        findings += _axes(pieces, section)
        section = mended(section, findings)  # all else is looked at the right way up
        ours = turned(pieces, section)
        sight = look_around(ours)
        findings += _parts(ours, section, sight)
        findings += [*_texture(ours, section, base, sight), *_outside(ours, sight)]
    if not any(finding.severity == "fault" for finding in findings):
        findings += _reading(section, base)
    order = ("fault", "warning", "note")
    return sorted(findings, key=lambda finding: order.index(finding.severity))


def mended(section: VehicleSection, findings: Sequence[Finding]) -> VehicleSection:
    """The section with all keys that the findings propose."""
    keys: dict[str, object] = {}
    for finding in findings:
        keys |= finding.keys
    if isinstance(materials := keys.get("materials"), dict):
        keys["materials"] = section.materials | materials
    return section.model_copy(update=keys)


def as_yaml(value: object) -> str:
    """A value or mapping on one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {as_yaml(part)}" for key, part in value.items()) + "}"
    return str(value).lower() if isinstance(value, bool) else str(value)


def _triangles(pieces: Sequence[Piece]) -> Iterator[Finding]:
    lost = sum(int((~np.isfinite(piece.vertices)).any(axis=1).sum()) for piece in pieces)
    if lost:
        number = f"{lost} vertices are NaN or infinite"
        yield Finding("fault", "vertices", number, "export the mesh again")
    empty = [piece.name for piece in pieces if not (piece.areas > 0).any()]
    if empty:
        number = f"{len(empty)} without any area ({_listed(empty)})"
        yield Finding("fault", "parts", number, "remove them in the modelling program")
    flat = sum(int((piece.areas == 0).sum()) for piece in pieces)
    number = f"{flat} of {sum(len(p.faces) for p in pieces)} in {len(pieces)} parts have no area"
    yield Finding("note", "triangles", number, "left out when the mesh is read" if flat else "")


def _axes(pieces: Sequence[Piece], section: VehicleSection) -> Iterator[Finding]:
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
    length, height = (spans["xyz".index(axis)] for axis in (found.front[1], found.up))
    metres = [section.scale * span for span in (length, spans.sum() - length - height, height)]
    size = " × ".join(f"{each:.3g}" for each in metres) + " m"
    if CAR_LENGTH[0] <= metres[0] <= CAR_LENGTH[1]:
        yield Finding("note", "size", size)
    else:
        scale, unit = guess_scale(length)
        severity: Severity = "warning" if SHORTEST <= metres[0] <= LONGEST else "fault"
        number = f"{size}; cars are {CAR_LENGTH[0]:g} to {CAR_LENGTH[1]:g} m long"
        yield Finding(severity, "size", number, unit, {"scale": scale})


def _parts(pieces: Sequence[Piece], section: VehicleSection, sight: Sight) -> Iterator[Finding]:
    kinds = {piece.material: piece.kind for piece in pieces}
    for kind in sorted(set(kinds.values())):
        named = [material for material, own in kinds.items() if own == kind]
        share = sight.share(np.isin(sight.piece, _of(pieces, named)))
        yield Finding(
            "note", f"looks like {kind}", f"{share:.1%} of what is seen: {_listed(named)}"
        )
    if len(kinds) == 1:
        if not section.paint_mask:
            number = "a single one; glass, lights and tyres would be painted, too"
            yield Finding("warning", "materials", number, "draw a vehicle.paint_mask")
        return
    unknown = [
        material
        for material, kind in kinds.items()
        if kind == "trim" and material not in {*section.materials, "trim"}
        if sight.share(np.isin(sight.piece, _of(pieces, [material]))) > WORTH_A_WORD
    ]
    proposed = _by_part_names(pieces, unknown)
    if "paint" not in {*kinds.values(), *proposed.values()}:
        proposed[_largest(pieces, unknown or list(kinds))] = "paint"
    if "paint" not in kinds.values():
        number = f"none is known as paint: {_listed(kinds)}"
        yield Finding("fault", "materials", number, keys={"materials": proposed})
    elif proposed:
        number = f"dark trim, but their parts are named otherwise: {_listed(proposed)}"
        yield Finding("warning", "materials", number, keys={"materials": proposed})
    missing = [kind for kind in EXPECTED if kind not in {*kinds.values(), *proposed.values()}]
    if missing:
        number = f"none is known as {', '.join(missing)}; dark trim: {_listed(unknown) or 'none'}"
        yield Finding("warning", "materials", number, "name them in vehicle.materials")


def _of(pieces: Sequence[Piece], materials: Collection[str]) -> list[int]:
    return [k for k, piece in enumerate(pieces) if piece.material in materials]


def _by_part_names(pieces: Sequence[Piece], materials: Sequence[str]) -> dict[str, str]:
    """What the names of the parts say of materials whose own names say nothing."""
    found = {}
    for material in materials:
        votes = Counter(guess_material(p.name) for p in pieces if p.material == material)
        if len(votes) == 1 and "trim" not in votes:
            found[material] = next(iter(votes))
    return found


def _largest(pieces: Sequence[Piece], materials: Sequence[str]) -> str:
    """The material of the largest area."""
    area = {m: sum(pieces[k].areas.sum() for k in _of(pieces, [m])) for m in materials}
    return max(area, key=area.__getitem__)


def _texture(
    pieces: Sequence[Piece], section: VehicleSection, base: Path, sight: Sight
) -> Iterator[Finding]:
    if not any(piece.kind == "paint" for piece in pieces):
        return
    if section.unwrap:
        yield Finding("note", "UVs", "made anew (vehicle.unwrap); the file's are not used")
        return
    mask = read_mask(base / section.paint_mask) if section.paint_mask else None
    use, unwrap = measure_uvs(pieces, sight, mask), {"unwrap": True}
    if use.missing:
        yield Finding("fault", "UVs", f"{_listed(use.missing)} have none", keys=unwrap)
    if use.outside:
        number = f"{_listed(use.outside)} leave [0, 1]: they span {use.span}"
        yield Finding("fault", "UVs", number, "or pack them into [0, 1]", unwrap)
    if use.pointlike > WORTH_A_WORD:
        number = f"{use.pointlike:.1%} of the paint lies on points or lines of the texture"
        severity: Severity = "fault" if use.pointlike > 0.5 else "warning"
        yield Finding(severity, "UVs", number, keys=unwrap)
    reorder = _reorder(section, base)
    if use.overlap > WORTH_A_WORD:
        number = f"{use.overlap:.1%} of the texture in use is used more than once"
        yield Finding("warning", "UVs overlap", number, f"or {reorder}", unwrap)
    if use.mirrored > WORTH_A_WORD:
        number = f"{use.mirrored:.1%} of the paint shows the texture mirrored"
        yield Finding("warning", "UVs mirrored", number, reorder)
    if use.spread > SPREAD:
        number = f"{use.spread:.3g} times more texels per metre in one place than in another"
        yield Finding("warning", "UVs uneven", number, reorder)
    number = (
        f"overlap {use.overlap:.1%}, mirrored {use.mirrored:.1%}, texels per metre, "
        f"95th over 5th percentile: {use.spread:.3g}"
    )
    yield Finding("note", "UVs", number)


def _reorder(section: VehicleSection, base: Path) -> str:
    """The command that lays out the vehicle's UVs anew."""
    given = section.model_dump(include={"up", "front", "scale"}, exclude_defaults=True)
    textures = {"paint-mask": section.paint_mask, "base-texture": section.base_texture}
    given |= {key: base / path for key, path in textures.items() if path}
    flags = "".join(f" --{key} {value}" for key, value in given.items())
    mesh = section.mesh if section.mesh.startswith(BUILTIN) else base / section.mesh
    return f"cnca reorder-uv {mesh} -o OUT.obj" + ("" if mesh == section.mesh else flags)


def _outside(pieces: Sequence[Piece], sight: Sight) -> Iterator[Finding]:
    bare = [piece.name for piece in pieces if piece.normals is None]
    if bare:
        number = f"{len(bare)} of {len(pieces)} parts have none"
        yield Finding("note", "normals", number, "smooth ones are made")
    inwards = _inward_normals(pieces)
    if inwards > WORTH_A_WORD:
        number = f"{inwards:.1%} of the area has some that point to the triangles' backs"
        yield Finding("warning", "normals", number, RECALCULATE)
    count = len(pieces)
    shown = np.bincount(sight.piece, minlength=count)
    backs = np.bincount(sight.piece, sight.back, minlength=count)
    worst = np.flatnonzero((backs > 0.5 * shown) & (shown > WORTH_A_WORD * shown.sum()))
    if len(worst):
        which = _listed([pieces[k].name for k in worst.tolist()])
        number = f"{sight.share(sight.back):.1%} of what is seen are backs of triangles: {which}"
        yield Finding("warning", "inside out", number, RECALCULATE)


def _inward_normals(pieces: Sequence[Piece]) -> float:
    """Share of the area of pieces with normals on which these look away from the face's own."""
    wrong = total = 0.0
    for piece in pieces:
        if piece.normals is not None:
            own = face_crosses(piece.vertices, piece.faces)
            against = (own * piece.normals[piece.faces].mean(axis=1)).sum(axis=1) < 0
            wrong, total = wrong + piece.areas[against].sum(), total + piece.areas.sum()
    return wrong / total if total else 0.0


def _reading(section: VehicleSection, base: Path) -> Iterator[Finding]:
    """The last word has the reader that scenes have."""
    options = {"up", "front", "scale", "materials", "unwrap"}
    try:
        resolve_vehicle(section.mesh, base, **section.model_dump(include=options))
    except MeshError as error:
        yield Finding("fault", "reading", str(error))


def _listed(names: Collection[str]) -> str:
    """The first names, and how many more there are."""
    more = f" and {len(names) - 4} more" if len(names) > 4 else ""
    return ", ".join(list(names)[:4]) + more
