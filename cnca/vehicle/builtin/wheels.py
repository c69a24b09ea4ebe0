"""Wheels as surfaces of revolution, and the dark wells in which they turn."""

from __future__ import annotations

import numpy as np

from cnca.vehicle.builtin.bodywork import Body
from cnca.vehicle.mesh.surface import Surface, join, revolved

TYRE_WIDTH = 0.215
WELL_GAP = 0.05
"""Between the tyre and the arch, metres."""
SEGMENTS = 30
SPOKES = 5


def place_wheels(body: Body) -> dict[str, Surface]:
    """Four wheels that stand on z = 0, by material."""
    radius = body.shape.wheel_radius
    pieces: dict[str, list[Surface]] = {}
    for axle in body.axles:
        outer = body.shape.width / 2 * float(body.plan(np.array(axle))) - 0.025
        for material, piece in _left_wheel(radius, body.coarse).items():
            left = piece.moved((axle, outer - TYRE_WIDTH / 2, radius))
            pieces.setdefault(material, []).extend([left, left.mirrored()])
    return {material: join(surfaces) for material, surfaces in pieces.items()}


def cut_wells(skin: Surface, body: Body) -> tuple[Surface, Surface]:
    """Open the wheel arches of a closed skin; return it and the wells' lining.

    Skin and lining together are closed again: the lining runs from the arch's edge inwards.
    """
    depth = body.shape.width / 2 - TYRE_WIDTH - 0.10
    radius = body.shape.wheel_radius
    arches = [np.hypot(skin.x - axle, skin.z - radius) for axle in body.axles]
    hole = np.maximum(np.min(arches, axis=0) - radius - WELL_GAP, depth - np.abs(skin.y))
    _, opened = skin.split(hole)

    edges = opened.boundary()
    rim, edges = np.unique(edges, return_inverse=True)
    edges = edges.reshape(-1, 2)
    mouth = opened.vertices[rim]
    end = np.stack([mouth[:, 0], np.sign(mouth[:, 1]) * depth, mouth[:, 2]], axis=1)
    centres = [(axle, side * depth, radius) for axle in body.axles for side in (1, -1)]
    vertices = np.concatenate([mouth, end, centres])
    nearest = np.linalg.norm(end[:, None] - np.array(centres), axis=-1).argmin(axis=1)
    a, b = edges.T
    c, d, centre = a + len(rim), b + len(rim), 2 * len(rim) + nearest[a]
    walls = [np.stack(triangle, axis=1) for triangle in ((b, a, c), (b, c, d), (d, c, centre))]
    return opened, Surface.smooth(vertices, np.concatenate(walls))


def _left_wheel(radius: float, coarse: bool) -> dict[str, Surface]:
    """A wheel around the y axis with its rim's face towards +y, by material."""
    segments, rings = (20, 3) if coarse else (SEGMENTS, 7)
    side, rim = TYRE_WIDTH / 2, 0.70 * radius
    flank = [(rim, 0.92), (0.90 * radius, 1.0), (0.97 * radius, 0.86), (radius, 0.62)]
    tyre = [(r, -y * side) for r, y in flank] + [(r, y * side) for r, y in flank[::-1]]
    radii = np.linspace(0.93, 0.22, rings)
    spans = [(t * rim, (0.62 + 0.12 * t**2) * side) for t in radii]
    dish = [(rim, 0.92 * side), (0.95 * rim, 0.93 * side), *spans, (0.0, 0.66 * side)]
    face = revolved(np.array(dish), segments)

    distance, angle = np.hypot(face.x, face.z), np.arctan2(face.z, face.x)
    between = np.pi / SPOKES - np.abs(angle % (2 * np.pi / SPOKES) - np.pi / SPOKES)
    openings = np.max(
        [0.09 * rim - distance * np.sin(between), distance - 0.90 * rim, 0.28 * rim - distance],
        axis=0,
    )
    _, spokes = face.split(openings)
    round_about = 14 if coarse else segments
    behind = revolved(np.array([(rim, 0.3 * side), (0.0, 0.3 * side)]), round_about)
    barrel = revolved(np.array([(0.0, -0.9 * side), (rim, -0.92 * side)]), round_about)
    return {
        "tyre": revolved(np.array(tyre), round_about),
        "metal": spokes,
        "underbody": join([behind, barrel]),
    }
