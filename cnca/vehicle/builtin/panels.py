"""What is cut out of the skin: windows, lights, grille, plates, gaps, and the paint around them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cnca.vehicle.builtin.bodywork import END_LIFT, Body
from cnca.vehicle.mesh.surface import Surface

Distance = Float[np.ndarray, " vertices"]
Pair = tuple[float, float]
SEAL = 0.018
"""Width of the dark rubber around windows and lights, metres."""
GAP = 0.008
"""Width of the gaps around doors and lids, metres."""


@dataclass(frozen=True)
class Region:
    """A piece of the skin with one material: where ``distance`` (metres) is negative."""

    material: str
    distance: Callable[[Surface], Distance]
    recess: float = 0.0
    """How far the piece lies behind the skin, lengthwise towards the middle, in metres."""

    def cut(self, skin: Surface) -> tuple[Surface, Surface]:
        """Return the piece and the rest of the skin."""
        piece, rest = skin.split(self.distance(skin))
        if self.recess > 0 and len(piece.faces):
            inwards = -np.sign(piece.x.mean()) * self.recess
            piece = piece.recessed((inwards, 0.0, 0.0))
        return piece, rest

    def grown(self, margin: float, material: str) -> Region:
        """The region and a strip of ``margin`` metres around it."""
        return Region(material, lambda skin: self.distance(skin) - margin)


def regions(body: Body) -> list[Region]:
    """All regions in the order in which they are cut; what is left over is paint."""
    glass = [windscreen(body), rear_window(body), *side_windows(body)]
    sealed = [*glass, *lights(body)]
    # Seals and gaps are thinner than a pixel on vehicles that only pass by.
    seals = [] if body.coarse else sealed
    outlines = [] if body.coarse else [*door_outlines(body), *lids(body)]
    doors = [Region("paint", door) for door in outlines]
    cover = [Region("trim", lambda skin: bed_cover(body, skin))] if body.shape.open_bed else []
    return [
        *cover,
        Region("underbody", lambda skin: skin.z - body.shape.clearance - END_LIFT - 0.02),
        *pillars(body),
        *sealed,
        *(region.grown(SEAL, "trim") for region in seals),
        *grille_and_plates(body),
        *doors,
        *(door.grown(GAP, "trim") for door in doors),
    ]


def windscreen(body: Body) -> Region:
    """Between bonnet and roof, as wide as the pillars allow."""
    return Region(
        "glass", lambda skin: _between(body, skin, body.roof_front + 0.04, body.cowl - 0.04)
    )


def rear_window(body: Body) -> Region:
    """Between roof and boot, or in the upper half of the tail gate."""
    s = body.shape
    if s.boot_length > 0:
        return Region(
            "glass", lambda skin: _between(body, skin, body.deck + 0.05, body.roof_rear - 0.05)
        )
    low, high = s.belt_height + s.belt_rise + 0.05, body.tail_top - 0.015
    half = float(body.corner(np.array(-0.8 * body.nose))) - 0.11

    def distance(skin: Surface) -> Distance:
        frame = _box(skin.y, skin.z, (0.0, (low + high) / 2), (half, (high - low) / 2), 0.07)
        return np.maximum(frame, skin.x + body.nose - 0.9 * s.rear_window_run - 0.12)

    return Region("glass", distance)


def side_windows(body: Body) -> list[Region]:
    """One opening per side and door, under the roof's rail and above the belt."""
    return [Region("glass", lambda skin: _side_opening(body, skin))]


def pillars(body: Body) -> list[Region]:
    """The dark posts between the side windows."""

    def distance(skin: Surface) -> Distance:
        post = np.min([np.abs(skin.x - x) - 0.04 for x in pillar_positions(body)], axis=0)
        return np.maximum(post, _side_opening(body, skin))

    return [Region("trim", distance)]


def pillar_positions(body: Body) -> tuple[float, ...]:
    """x of the post behind the front door, and of the one behind the rear door."""
    front = 0.5 * (body.axles[0] + body.axles[1]) - 0.02
    return front, body.axles[1] + 0.12


def bed_cover(body: Body, skin: Surface) -> Distance:
    """The tarpaulin of a pickup between its cabin and its tail gate."""
    box = _box(
        skin.x,
        skin.y,
        (body.deck - 0.5 * body.shape.boot_length, 0.0),
        (0.5 * body.shape.boot_length - 0.09, 0.41 * body.shape.width),
        0.05,
    )
    return np.maximum(box, body.belt(skin.x) - 0.02 - skin.z)


def lights(body: Body) -> list[Region]:
    """Headlights and tail lights, which reach around the corners and rise outwards."""
    half = body.shape.width / 2

    def head(skin: Surface) -> Distance:
        z = skin.z - body.waist - 0.17 - 0.12 * (np.abs(skin.y) - 0.8 * half)
        lamp = _box(np.abs(skin.y), z, (0.81 * half, 0.0), (0.25 * half, 0.065), 0.05)
        return np.maximum(lamp, body.nose - 0.50 - skin.x)

    def tail(skin: Surface) -> Distance:
        z = skin.z - _lid_height(body) + 0.17
        lamp = _box(np.abs(skin.y), z, (0.82 * half, 0.0), (0.34 * half, 0.075), 0.04)
        return np.maximum(lamp, skin.x + body.nose - 0.38)

    return [Region("light", head), Region("tail_light", tail)]


def grille_and_plates(body: Body) -> list[Region]:
    """Number plates, the radiator grille in its frame, air intakes and the lower apron."""
    s = body.shape
    half = s.width / 2

    def front(a: Distance, skin: Surface, centre: Pair, size: Pair, radius: float) -> Distance:
        return np.maximum(_box(a, skin.z, centre, size, radius), body.nose - 0.5 - skin.x)

    def front_plate(skin: Surface) -> Distance:
        return front(skin.y, skin, (0.0, body.waist - 0.02), (0.26, 0.056), radius=0.01)

    def rear_plate(skin: Surface) -> Distance:
        centre = (0.0, _lid_height(body) - 0.22)
        return np.maximum(_box(skin.y, skin.z, centre, (0.26, 0.056), 0.01), skin.x)

    def grille(skin: Surface) -> Distance:
        return front(skin.y, skin, (0.0, body.waist + 0.08), (0.46 * half, 0.16), radius=0.07)

    def intakes(skin: Surface) -> Distance:
        centre = (0.76 * half, s.clearance + 0.20)
        return front(np.abs(skin.y), skin, centre, (0.17 * half, 0.06), radius=0.04)

    def apron(skin: Surface) -> Distance:
        between = np.minimum(skin.x - body.axles[1], body.axles[0] - skin.x)
        return np.maximum(skin.z - s.clearance - 0.13, between)

    def diffuser(skin: Surface) -> Distance:
        box = _box(skin.y, skin.z, (0.0, s.clearance + 0.10), (0.66 * half, 0.15), 0.06)
        return np.maximum(box, skin.x + body.nose - 0.5)

    def reflectors(skin: Surface) -> Distance:
        centre = (0.80 * half, s.clearance + 0.21)
        return np.maximum(_box(np.abs(skin.y), skin.z, centre, (0.10, 0.022), 0.02), skin.x)

    return [
        Region("plate", front_plate),
        Region("plate", rear_plate),
        Region("plate", rear_plate).grown(0.04, "trim"),
        Region("trim", grille, recess=0.03),
        Region("trim", grille).grown(0.016, "metal"),
        Region("trim", intakes, recess=0.05),
        Region("tail_light", reflectors),
        Region("trim", diffuser, recess=0.03),
        Region("trim", apron),
    ]


def door_outlines(body: Body) -> list[Callable[[Surface], Distance]]:
    """Distances to the four doors, two per side."""
    post = pillar_positions(body)[0]
    low = body.shape.clearance + 0.13
    reach = body.shape.wheel_radius + 0.16
    ends = [(body.axles[0] - reach, post), (post - GAP, body.axles[1] + 0.72 * reach)]

    def outline(front: float, rear: float) -> Callable[[Surface], Distance]:
        def distance(skin: Surface) -> Distance:
            high = body.belt(skin.x) - 0.01
            middle, half = (low + high) / 2, (high - low) / 2
            box = _box(
                skin.x, skin.z - middle, ((front + rear) / 2, 0.0), ((front - rear) / 2, half), 0.06
            )
            return np.maximum(box, 0.5 - np.abs(skin.y))

        return distance

    return [outline(front, rear) for front, rear in ends]


def lids(body: Body) -> list[Callable[[Surface], Distance]]:
    """Distances to the bonnet, and to the boot's lid or the tail gate."""
    s = body.shape

    def bonnet(skin: Surface) -> Distance:
        ends = np.maximum(skin.x - body.nose + 0.20, body.cowl + 0.02 - skin.x)
        sides = np.maximum(np.abs(skin.y) - 0.40 * s.width, body.waist - skin.z)
        return _soft_maximum(ends, sides, 0.06)

    def lid(skin: Surface) -> Distance:
        front = body.deck - 0.06 if s.boot_length > 0 else 0.75 * s.rear_window_run - body.nose
        ends = np.maximum(skin.x - front, body.waist + 0.13 - skin.z)
        return _soft_maximum(ends, np.abs(skin.y) - 0.39 * s.width, 0.06)

    return [bonnet, lid]


def _lid_height(body: Body) -> float:
    """Height of the boot, or of the tail gate's window: what is below carries lights and plate."""
    s = body.shape
    return s.boot_height if s.boot_length > 0 else s.belt_height + s.belt_rise


def _between(body: Body, skin: Surface, rear: float, front: float) -> Distance:
    """Distance to the part of the top between two x, inside the pillars."""
    side = np.abs(skin.y) - body.corner(skin.x) + 0.055
    ends = np.maximum(rear - skin.x, skin.x - front)
    above = body.belt(skin.x) - skin.z
    return np.maximum(_soft_maximum(side, ends, 0.05), above)


def _side_opening(body: Body, skin: Surface) -> Distance:
    """Distance to the side windows: above the belt, below the roof's rail."""
    s = body.shape
    low = body.belt(skin.x) + 0.035 - skin.z
    high = skin.z - body.top(skin.x) + 0.125
    opening = _soft_maximum(low, high, 0.03)
    last = -body.nose + 0.30 + 0.8 * s.rear_window_run if s.boot_length == 0 else body.deck
    if s.windowless_behind is not None:
        last = s.windowless_behind
    return np.max([opening, last - skin.x, 0.35 * s.width - np.abs(skin.y)], axis=0)


def _box(
    a: Distance,
    b: Distance,
    centre: Pair,
    half: Pair | tuple[float, Distance],
    radius: float,
) -> Distance:
    """Signed distance to a rectangle with rounded corners in the plane (a, b)."""
    p, q = np.abs(a - centre[0]) - half[0] + radius, np.abs(b - centre[1]) - half[1] + radius
    outside = np.hypot(np.maximum(p, 0.0), np.maximum(q, 0.0))
    return outside + np.minimum(np.maximum(p, q), 0.0) - radius


def _soft_maximum(a: Distance, b: Distance, width: float) -> Distance:
    """A maximum whose kink is rounded over ``width`` metres."""
    return 0.5 * (a + b + np.sqrt((a - b) ** 2 + width**2))
