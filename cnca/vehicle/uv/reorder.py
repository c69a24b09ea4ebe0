"""A new UV layout in which the painted outside of a vehicle lies connected (paper, appendix).

What can be seen from outside is unfolded around the top; all else (inner sides, glass and wheels
that share the texture) is cut into charts by xatlas and put into the free space below.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import xatlas
from jaxtyping import Bool, Float

from cnca.core.errors import MeshError
from cnca.vehicle.model import Part, Vehicle
from cnca.vehicle.uv.layout import measure
from cnca.vehicle.uv.skin import Skin
from cnca.vehicle.uv.unfold import unfold

MARGIN = 0.04
"""Metres around the unfolded charts, and between them and the rest."""
SHEARS = (0.02, 0.005, 0.002)
"""Weights of the shear against the mismatch of charts along their common edge; see ``unfold``."""
REST_TEXELS = 1024
"""Texture size for which xatlas keeps the rest's charts apart."""


@dataclass(frozen=True)
class Reordered:
    """A vehicle with its new layout; the faces of all painted parts, one part after the other."""

    vehicle: Vehicle
    outside: Bool[np.ndarray, " faces"]
    """Painted faces that can be seen from outside."""
    placed: Bool[np.ndarray, " faces"]
    """Those of them that lie in the unfolded charts."""


def reorder(vehicle: Vehicle, painted: Bool[np.ndarray, " faces"] | None = None) -> Reordered:
    """Lay the paint out anew; shapes, normals and the order of faces stay.

    Of several weights against shear, the one with the shortest seams is taken.

    Args:
        painted: faces that the camouflage will cover, where a mask says so; None for all.

    Raises:
        MeshError: nothing is painted, or nothing of it can be seen from outside.
    """
    layouts = [_laid_out(vehicle, painted, shear) for shear in SHEARS]
    return min(layouts, key=lambda one: measure(Skin.of(one.vehicle), one.outside).seam_length)


def _laid_out(
    vehicle: Vehicle, painted: Bool[np.ndarray, " faces"] | None, shear: float
) -> Reordered:
    skin = Skin.of(vehicle)
    chosen = np.ones(len(skin.faces), bool) if painted is None else painted
    outside, placed = np.zeros((2, len(skin.faces)), bool)
    corners = np.zeros((len(skin.faces), 3, 2))
    panes = [p.vertices[p.faces] for p in vehicle.parts if p.material == "glass"]
    glass = np.concatenate([np.zeros((0, 3, 3)), *panes])
    outside[chosen], placed[chosen], corners[chosen] = unfold(
        skin.vertices, skin.faces[chosen], glass, shear=shear
    )
    if not placed.any():
        raise MeshError(f"{vehicle.name}: no painted face can be seen from outside")
    low, high = (end(corners[placed], axis=(0, 1)) for end in (np.min, np.max))
    width, height = high - low + 2 * MARGIN
    side = max(width, height)
    corners[placed] += MARGIN - low
    corners[placed, :, 1] += side - height
    if not placed.all():
        room = max(side - height, 0.25 * side)
        if room > side - height:  # too little below: make the square larger
            corners[placed, :, 1] += height + room - side
            side = height + room
        corners[~placed] = MARGIN + (room - 2 * MARGIN) * _rest(skin, ~placed)
    return Reordered(_with_layout(vehicle, corners / side), outside, placed)


def _rest(skin: Skin, chosen: Bool[np.ndarray, " faces"]) -> Float[np.ndarray, "chosen 3 2"]:
    """Corners in [0, 1]² that xatlas gives the chosen faces."""
    used, faces = np.unique(skin.faces[chosen], return_inverse=True)
    atlas = xatlas.Atlas()
    atlas.add_mesh(skin.vertices[used].astype(np.float32), faces.reshape(-1, 3).astype(np.uint32))
    packing = xatlas.PackOptions()
    packing.resolution, packing.padding, packing.bilinear = REST_TEXELS, 4, True
    packing.rotate_charts = False
    cutting = xatlas.ChartOptions()
    cutting.fix_winding = True  # none of them mirrored
    atlas.generate(cutting, packing)
    if atlas.atlas_count != 1:
        raise MeshError(f"the hidden faces fall into {atlas.atlas_count} atlases, not one")
    _, laid_out, uvs = atlas[0]
    return uvs.astype(float)[laid_out].clip(0, 1)


def _with_layout(vehicle: Vehicle, corners: Float[np.ndarray, "faces 3 2"]) -> Vehicle:
    """The vehicle with these texture coordinates; vertices on chart borders are doubled."""
    parts, first = [], 0
    for part in vehicle.parts:
        if part.material == "paint":
            part_corners = corners[first : first + len(part.faces)]
            first += len(part.faces)
            part = _part_with_layout(part, part_corners)
        parts.append(part)
    return replace(vehicle, parts=tuple(parts))


def _part_with_layout(part: Part, corners: Float[np.ndarray, "faces 3 2"]) -> Part:
    uvs = corners.reshape(-1, 2).round(7).clip(0, 1)
    keys = np.column_stack([part.faces.ravel(), uvs])
    _, first, faces = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    old = part.faces.ravel()[first]
    return replace(
        part,
        vertices=part.vertices[old],
        normals=part.normals[old],
        faces=faces.reshape(-1, 3),
        uvs=uvs[first],
    )
