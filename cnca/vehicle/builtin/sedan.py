"""Built-in vehicles: the whole car from a few dimensions, without any file."""

from __future__ import annotations

import numpy as np

from cnca.vehicle.builtin.bodywork import Body
from cnca.vehicle.builtin.panels import pillar_positions, regions
from cnca.vehicle.builtin.shapes import BUILTIN_VEHICLES, SedanShape
from cnca.vehicle.builtin.wheels import cut_wells, place_wheels
from cnca.vehicle.mesh.surface import Surface, ellipsoid, join
from cnca.vehicle.model import Part, Vehicle
from cnca.vehicle.uv.atlas import paint_atlas

__all__ = ["BUILTIN_VEHICLES", "SedanShape", "build_sedan"]


def build_sedan(
    shape: SedanShape = BUILTIN_VEHICLES["sedan"], name: str = "builtin:sedan"
) -> Vehicle:
    """Return the vehicle of the given shape: one part per material, wheels on z = 0.

    The painted part carries UVs in [0, 1]² (see :mod:`cnca.vehicle.uv.atlas`).
    """
    body = Body(shape)
    surfaces = body_surfaces(body)
    return Vehicle(name, tuple(_part(body, material, mesh) for material, mesh in surfaces.items()))


def body_surfaces(body: Body) -> dict[str, Surface]:
    """Everything that the vehicle consists of, by material."""
    skin, wells = cut_wells(body.skin(), body)
    pieces: dict[str, list[Surface]] = {"underbody": [wells]}
    for region in regions(body):
        piece, skin = region.cut(skin)
        pieces.setdefault(region.material, []).append(piece)
    pieces.setdefault("paint", []).append(skin)
    for material, surface in [*place_wheels(body).items(), *fittings(body)]:
        pieces.setdefault(material, []).append(surface)
    return {material: join(surfaces) for material, surfaces in pieces.items()}


def fittings(body: Body) -> list[tuple[str, Surface]]:
    """Mirrors and door handles with their materials."""
    s = body.shape
    foot = body.cowl - 0.42
    high = float(body.belt(np.array(foot))) + 0.075
    rings = 4 if body.coarse else 8
    radii = (0.055, 0.095, 0.065)
    left = [("trim", ellipsoid((foot, s.width / 2 + 0.03, high), radii, rings))]
    for post in pillar_positions(body):
        x = post + 0.14
        z = float(body.belt(np.array(x))) - 0.09
        y = 0.97 * s.width / 2 * float(body.plan(np.array(x)))
        left.append(("metal", ellipsoid((x, y, z), (0.09, 0.03, 0.014), rings)))
    return left + [(material, surface.mirrored()) for material, surface in left]


def _part(body: Body, material: str, surface: Surface) -> Part:
    uvs = None
    if material == "paint":
        has_boot = body.shape.boot_length > 0
        surface, uvs = paint_atlas(surface, body.shape.height if has_boot else body.tail_top - 0.02)
    return Part(material, material, surface.vertices, surface.faces, surface.normals, uvs)
