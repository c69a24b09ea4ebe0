"""A new UV atlas for vehicles whose own texture coordinates are missing or overlap."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import xatlas

from cnca.core.errors import MeshError
from cnca.vehicle.model import Part, Vehicle


def unwrap_paint(vehicle: Vehicle, *, texels: int = 1024, padding: int = 4) -> Vehicle:
    """Return the vehicle with all painted parts laid out side by side in one atlas.

    The charts do not overlap and keep ``padding`` texels between them in a texture of ``texels``².
    Vertices on chart borders are doubled; shapes, normals and other parts stay as they are.
    Raises MeshError if nothing is painted or no single atlas can be made.
    """
    painted = [part for part in vehicle.parts if part.material == "paint"]
    if not painted:
        raise MeshError(f"{vehicle.name}: nothing to unwrap, since no part is paint")
    atlas = xatlas.Atlas()
    for part in painted:
        vertices, normals = part.vertices.astype(np.float32), part.normals.astype(np.float32)
        atlas.add_mesh(vertices, part.faces.astype(np.uint32), normals)
    packing = xatlas.PackOptions()
    packing.resolution = texels
    packing.padding = padding
    packing.bilinear = True
    packing.rotate_charts = False
    cutting = xatlas.ChartOptions()
    cutting.fix_winding = True  # writing reads forwards
    atlas.generate(cutting, packing)
    if atlas.atlas_count != 1:
        raise MeshError(
            f"{vehicle.name}: the paint falls into {atlas.atlas_count} atlases, not one"
        )
    laid_out = iter([_laid_out(part, *atlas[i]) for i, part in enumerate(painted)])
    parts = (next(laid_out) if part.material == "paint" else part for part in vehicle.parts)
    return replace(vehicle, parts=tuple(parts))


def _laid_out(part: Part, kept: np.ndarray, faces: np.ndarray, uvs: np.ndarray) -> Part:
    """``kept[i]`` is the old index of the new vertex i."""
    return replace(
        part,
        vertices=part.vertices[kept],
        normals=part.normals[kept],
        faces=faces.astype(np.int64),
        uvs=uvs.astype(float).clip(0, 1),
    )
