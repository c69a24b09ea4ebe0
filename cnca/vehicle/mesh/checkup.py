"""What stands between a mesh and an attack on it: one finding for each thing that was looked at."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from cnca.core.errors import MeshError
from cnca.core.images import read_mask
from cnca.scene.schema import VehicleSection
from cnca.vehicle.mesh.finding import Finding, Severity, as_yaml, listed
from cnca.vehicle.mesh.load_mesh import BUILTIN, resolve_vehicle
from cnca.vehicle.mesh.makeup import check_materials
from cnca.vehicle.mesh.pieces import (
    OURS,
    Piece,
    as_made_of,
    paint_picture,
    read_pieces,
    sound,
    turned,
)
from cnca.vehicle.mesh.sight import Sight, look_around
from cnca.vehicle.mesh.standing import check_axes, check_place
from cnca.vehicle.mesh.surface import face_crosses
from cnca.vehicle.uv.uv_checkup import measure_uvs

WORTH_A_WORD = 0.01
"""Share of what is seen, or of the texture, below which nothing is said."""
SPREAD = 4.0
"""Texels per metre, 95th over 5th percentile: one part is that much blurrier than another."""
SCENE_ENDINGS = (".yaml", ".yml")
RECALCULATE = "recalculate normals outside in the modelling program"


def check(section: VehicleSection, base: Path, source: str = "") -> list[Finding]:
    """Everything that there is to say about a scene's vehicle, the worst first.

    ``source`` is the file that was given, as proposed commands are to name it.

    Raises MeshError where the file cannot be read at all, TextureError where its mask cannot.
    """
    raw = read_pieces(section, base)
    if section.mesh.startswith(BUILTIN):
        section = section.model_copy(update=OURS)
    findings = list(_triangles(raw))
    pieces = sound(raw)
    if pieces:
        findings += check_axes(pieces, section)
        section = mended(section, findings)  # all else is looked at the right way up
        ours = turned(pieces, section)
        sight = look_around(ours)
        findings += check_place(ours, section)
        findings += check_materials(ours, section, sight, base)
        section = mended(section, findings)
        ours = ours if section.mesh.startswith(BUILTIN) else as_made_of(ours, section)
        findings += [*_texture(ours, section, base, sight, source), *_outside(ours, sight)]
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


def _triangles(pieces: Sequence[Piece]) -> Iterator[Finding]:
    lost = sum(int((~np.isfinite(piece.vertices)).any(axis=1).sum()) for piece in pieces)
    if lost:
        number = f"{lost} vertices are NaN or infinite"
        yield Finding("fault", "vertices", number, "export the mesh again")
    empty = [piece.name for piece in pieces if not (piece.areas > 0).any()]
    if empty:
        number = f"{len(empty)} without any area ({listed(empty)})"
        yield Finding("fault", "parts", number, "remove them in the modelling program")
    flat = sum(int((piece.areas == 0).sum()) for piece in pieces)
    number = f"{flat} of {sum(len(p.faces) for p in pieces)} in {len(pieces)} parts have no area"
    yield Finding("note", "triangles", number, "left out when the mesh is read" if flat else "")


def _texture(
    pieces: Sequence[Piece], section: VehicleSection, base: Path, sight: Sight, source: str
) -> Iterator[Finding]:
    if not any(piece.kind == "paint" for piece in pieces):
        return
    drawn = [key for key in ("paint_mask", "base_texture") if getattr(section, key)]
    if section.unwrap:
        number = "made anew (vehicle.unwrap); the file's are not used"
        its = f"; {' and '.join(drawn)} must be drawn on the new layout" if drawn else ""
        yield Finding("note", "UVs", number + its)
        return
    mask = read_mask(base / section.paint_mask) if section.paint_mask else None
    use = measure_uvs(pieces, sight, mask)
    if not section.base_texture and paint_picture(pieces) is not None:
        number = "the file has a picture of what it paints"
        yield Finding("note", "base_texture", number, "check-vehicle --out writes and names it")
    command = reorder_command(section, base, source)
    # New UVs would leave behind what is drawn on the file's own: reorder-uv carries it over.
    unwrap = {} if drawn else {"unwrap": True}
    lost = f"export UVs in [0, 1], which {' and '.join(drawn)} are drawn on" if drawn else ""
    if use.missing:
        yield Finding("fault", "UVs", f"{listed(use.missing)} have none", lost, unwrap)
    if use.outside:
        number = f"{listed(use.outside)} leave [0, 1]: they span {use.span}"
        yield Finding("fault", "UVs", number, lost or "or pack them into [0, 1]", unwrap)
    if use.pointlike > WORTH_A_WORD:
        number = f"{use.pointlike:.1%} of the paint lies on points or lines of the texture"
        severity: Severity = "fault" if use.pointlike > 0.5 else "warning"
        yield Finding(severity, "UVs", number, lost, unwrap)
    if use.overlap > WORTH_A_WORD:
        number = f"{use.overlap:.1%} of the texture in use is used more than once"
        yield Finding("warning", "UVs overlap", number, f"or {command}", unwrap)
    if use.mirrored > WORTH_A_WORD:
        number = f"{use.mirrored:.1%} of the paint shows the texture mirrored"
        yield Finding("warning", "UVs mirrored", number, command)
    if use.spread > SPREAD:
        number = f"{use.spread:.3g} times more texels per metre in one place than in another"
        yield Finding("warning", "UVs uneven", number, command)
    number = (
        f"overlap {use.overlap:.1%}, mirrored {use.mirrored:.1%}, texels per metre, "
        f"95th over 5th percentile: {use.spread:.3g}"
    )
    yield Finding("note", "UVs", number)


def reorder_command(section: VehicleSection, base: Path, source: str) -> str:
    """The command that lays out the vehicle's UVs anew.

    ``source`` is the scene file that the section stands in, or its mesh, with which the command
    must state the section's keys.
    """
    if Path(source).suffix in SCENE_ENDINGS:
        return shlex.join(["cnca", "reorder-uv", source, "-o", "OUT.obj"])
    words = ["cnca", "reorder-uv", source or str(base / section.mesh), "-o", "OUT.obj"]
    if not section.mesh.startswith(BUILTIN):
        given = section.model_dump(include={"up", "front", "scale"}, exclude_defaults=True)
        textures = {"paint-mask": section.paint_mask, "base-texture": section.base_texture}
        given |= {key: base / path for key, path in textures.items() if path}
        given |= {"materials": as_yaml(section.materials)} if section.materials else {}
        words += [word for key, value in given.items() for word in (f"--{key}", str(value))]
    return shlex.join(words)


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
        which = listed([pieces[k].name for k in worst.tolist()])
        number = f"{sight.share(sight.back):.1%} of what is seen are backs of triangles: {which}"
        yield Finding("warning", "inside out", number, RECALCULATE)


def _inward_normals(pieces: Sequence[Piece]) -> float:
    """Share of the area of pieces with normals on which these point against the face's own."""
    wrong = total = 0.0
    for piece in pieces:
        if piece.normals is not None:
            own = face_crosses(piece.vertices, piece.faces)
            against = (own * piece.normals[piece.faces].mean(axis=1)).sum(axis=1) < 0
            wrong, total = wrong + piece.areas[against].sum(), total + piece.areas.sum()
    return wrong / total if total else 0.0


def _reading(section: VehicleSection, base: Path) -> Iterator[Finding]:
    """The reader that scenes use has the last word."""
    options = {"up", "front", "scale", "materials", "unwrap", "recentre"}
    try:
        resolve_vehicle(section.mesh, base, **section.model_dump(include=options))
    except MeshError as error:
        yield Finding("fault", "reading", str(error))
