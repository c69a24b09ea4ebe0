"""What shines in a street: luminaires over the road, and the lights of cars."""

from __future__ import annotations

import math

import numpy as np

from cnca.core.photometry import CANDELAS
from cnca.scene.materials import LinearRgb
from cnca.world.builtin.meshes import Mesh
from cnca.world.model import Lamp

WARM, WHITE, RED = (1.0, 0.75, 0.47), (1.0, 0.97, 0.92), (1.0, 0.02, 0.01)
"""Linear sRGB of light of 3500 K and 6000 K, and of a tail light."""
LUMENS = 6000.0
"""Of a luminaire over a road."""
LOW_BEAM, TAIL = 8000.0, 8.0
"""Candelas; low beams have between 5,000 and 20,000 where they are brightest."""
DIP = 3.0
"""Degrees by which a low beam points down."""
BEAM = (3.0, 16.0)


def colored(candelas: float, color: LinearRgb) -> LinearRgb:
    """An intensity or a luminance of that color in the renderer's units."""
    luminance = float(np.dot(color, (0.2126, 0.7152, 0.0722)))
    red, green, blue = (candelas / CANDELAS * c / luminance for c in color)
    return red, green, blue


def luminaire(position: tuple[float, float, float], side: float = 0.3) -> Lamp:
    """A lamp that looks straight down."""
    return Lamp(position, (0.0, 0.0, -1.0), colored(LUMENS / math.pi, WARM), side)


def vehicle_lamps(head: Mesh, tail: Mesh) -> tuple[Lamp, ...]:
    """Two headlights and two tail lights in front of a vehicle's glasses; it heads along +x."""
    lamps = []
    dip = math.radians(DIP)
    for side in (-1.0, 1.0):
        forward = (math.cos(dip), 0.0, -math.sin(dip))
        at = _front_of(head, side, 1.0)
        lamps.append(Lamp(at, forward, colored(LOW_BEAM, WHITE), 0.12, BEAM))
        at = _front_of(tail, side, -1.0)
        lamps.append(Lamp(at, (-1.0, 0.0, 0.0), colored(TAIL, RED), 0.12))
    return tuple(lamps)


def _front_of(mesh: Mesh, side: float, ahead: float) -> tuple[float, float, float]:
    """The point before the middle of the glass on one side."""
    points = mesh.vertices[mesh.vertices[:, 1] * side > 0]
    y, z = (float((points[:, axis].min() + points[:, axis].max()) / 2) for axis in (1, 2))
    return float((points[:, 0] * ahead).max()) * ahead + 0.02 * ahead, y, z
