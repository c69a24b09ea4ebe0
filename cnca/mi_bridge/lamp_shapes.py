"""Lamps as Mitsuba's emitters: squares that shine, and beams of reflectors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cnca.mi_bridge.variant import mi
from cnca.mi_bridge.world_shapes import area_light, make_mesh
from cnca.world.model import Lamp

STRAY = 0.01
"""Part of a reflector's intensity that its glass shows to all sides."""
IN_FRONT = 0.03
"""Metres from the glass to where the beam starts."""


def lamp_shapes(lamps: Sequence[Lamp]) -> tuple[list[mi.Shape], list[mi.Emitter]]:
    """Squares that shine, and all emitters: theirs, and a spot for each reflector's beam.

    A square with a beam shines with :data:`STRAY` of it to all sides, so that it can be seen.
    """
    shapes, emitters = [], []
    black = mi.load_dict({"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}})
    for number, lamp in enumerate(lamps):
        share = 1.0 if lamp.beam is None else STRAY
        radiance = [share * c / lamp.side**2 for c in lamp.intensity]
        glow = area_light({"type": "rgb", "value": radiance})
        shape = _square(f"lamp_{number}", lamp, black, glow)
        shapes.append(shape)
        emitters.append(shape.emitter())
        if lamp.beam is not None:
            emitters.append(_spot(lamp))
    return shapes, emitters


def _square(name: str, lamp: Lamp, bsdf: mi.BSDF, glow: dict[str, object]) -> mi.Mesh:
    axis = np.array(lamp.direction)
    u = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    u /= np.linalg.norm(u)
    v, half = np.cross(axis, u), lamp.side / 2
    corners = [-u - v, u - v, u + v, -u + v]
    vertices = np.array(lamp.position) + half * np.array(corners)
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return make_mesh(name, bsdf, vertices, faces, np.tile(axis, (4, 1)), None, glow)


def _spot(lamp: Lamp) -> mi.Emitter:
    assert lamp.beam is not None
    full, end = lamp.beam
    position, axis = np.array(lamp.position), np.array(lamp.direction)
    up = np.eye(3)[np.abs(axis).argmin()]
    start = position + IN_FRONT * axis
    to_world = mi.ScalarTransform4f().look_at(
        origin=start.tolist(), target=(start + axis).tolist(), up=up.tolist()
    )
    return mi.load_dict(
        {
            "type": "spot",
            "to_world": to_world,
            "intensity": {"type": "rgb", "value": [float(c) for c in lamp.intensity]},
            "beam_width": full,
            "cutoff_angle": end,
        }
    )
