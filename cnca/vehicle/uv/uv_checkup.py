"""How a file uses its texture coordinates: missing, outside, overlapping, mirrored, uneven."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool

from cnca.vehicle.mesh.mesh_file import UV_TOLERANCE
from cnca.vehicle.mesh.pieces import Piece
from cnca.vehicle.mesh.sight import Sight
from cnca.vehicle.uv.layout import corner_keys, covered
from cnca.vehicle.uv.rebake import face_of_texels, shown_in
from cnca.vehicle.uv.skin import Skin

NO_AREA = 1e-9
"""Share of the texture below which a face shows no texel of its own (a tenth of one in 8192²)."""


@dataclass(frozen=True)
class UvUse:
    """Texture coordinates of the painted pieces; shares are those of the paint that is seen."""

    missing: list[str]
    """Pieces without any, or with some that are not numbers."""
    outside: list[str]
    """Pieces that leave [0, 1]."""
    span: str
    """Smallest and largest coordinate."""
    pointlike: float
    """Where the texture's triangle is a point or a line."""
    overlap: float
    """Share of the faces' texture area that other faces cover, too."""
    mirrored: float
    spread: float
    """Texels per metre, 95th over 5th percentile."""


def measure_uvs(
    pieces: Sequence[Piece],
    sight: Sight,
    mask: Bool[np.ndarray, "height width"] | None = None,
) -> UvUse:
    """Measure the texture coordinates of painted pieces; all pieces are in our axes and metres.

    With a ``mask`` only what it shows is paint.
    """
    painted = [piece for piece in pieces if piece.kind == "paint"]
    flat, twice = [], []
    for k, piece in enumerate(pieces):
        if piece.kind == "paint" and _has_uvs(piece):
            assert piece.uvs is not None
            seen = sight.face[(sight.piece == k) & ~sight.back]
            if mask is not None:
                seen = seen[shown_in(mask, piece.uvs[piece.faces[seen]])]
            corners = piece.uvs[piece.faces[seen]]
            twice.append(np.linalg.det(corners[:, 1:] - corners[:, :1]))
            flat.append(np.abs(twice[-1]) / 2 / piece.areas[seen])
    skin = skin_with_uvs(painted)
    if skin is None:
        return UvUse([piece.name for piece in painted], [], "", 0.0, 0.0, 0.0, 1.0)
    signed, density = np.concatenate(twice), np.sqrt(np.concatenate(flat))
    pointlike = np.abs(signed) / 2 < NO_AREA
    density = density[~pointlike]
    low, high = np.percentile(density, [5, 95]) if len(density) else (1.0, 1.0)
    corners = skin.corners if mask is None else skin.corners[shown_in(mask, skin.corners)]
    area = float(np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])).sum() / 2)
    beyond = [p for p in painted if _has_uvs(p) and _leaves_unit_square(p)]
    return UvUse(
        missing=[piece.name for piece in painted if not _has_uvs(piece)],
        outside=[piece.name for piece in beyond],
        span=f"[{skin.uvs.min():.3g}, {skin.uvs.max():.3g}]",
        pointlike=float(pointlike.mean()) if len(pointlike) else 0.0,
        overlap=max(0.0, 1 - covered(corners) / area) if area else 0.0,
        mirrored=float((signed[~pointlike] < 0).mean()) if len(density) else 0.0,
        spread=float(high / low),
    )


def skin_with_uvs(painted: Sequence[Piece]) -> Skin | None:
    """All painted triangles that have finite texture coordinates; None where no triangle has."""
    pieces = [piece for piece in painted if _has_uvs(piece)]
    if not pieces:
        return None
    starts = np.cumsum([0] + [len(piece.vertices) for piece in pieces[:-1]])
    return Skin(
        np.concatenate([piece.vertices for piece in pieces]),
        np.concatenate([p.faces + start for p, start in zip(pieces, starts, strict=True)]),
        np.concatenate([piece.uvs for piece in pieces if piece.uvs is not None]),
    )


def overlaps(skin: Skin, size: int) -> Bool[np.ndarray, "size size"]:
    """Texels of a ``size``² texture that are shown by two faces that do not touch."""
    corners = skin.corners
    last, first = face_of_texels(corners, size), face_of_texels(corners[::-1], size)
    first = np.where(first >= 0, len(corners) - 1 - first, -1)
    doubled = (first != last) & (first >= 0)
    keys = corner_keys(skin.vertices[skin.faces], corners)
    one, other = keys[first[doubled]], keys[last[doubled]]
    doubled[doubled] = (one[:, :, None] != other[:, None]).all(axis=(1, 2))
    # Charts side by side share the texels of their borders.
    return cv2.morphologyEx(doubled.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3))) > 0


def _has_uvs(piece: Piece) -> bool:
    return piece.uvs is not None and bool(np.isfinite(piece.uvs).all())


def _leaves_unit_square(piece: Piece) -> bool:
    assert piece.uvs is not None
    uvs = piece.uvs[np.unique(piece.faces)]
    return bool(uvs.min() < -UV_TOLERANCE or uvs.max() > 1 + UV_TOLERANCE)
