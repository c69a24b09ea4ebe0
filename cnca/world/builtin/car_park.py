"""``builtin:car_park``: the car park of a supermarket, with houses and trees around it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cnca.world.builtin.block import end_row
from cnca.world.builtin.facades import Style
from cnca.world.builtin.furniture import picket_fence, street_lamp, traffic_sign
from cnca.world.builtin.houses import draw_style, house
from cnca.world.builtin.meshes import rectangle
from cnca.world.builtin.plants import bush, hedge, tree
from cnca.world.builtin.roads import KERB, area, arrow, bar, kerb, line, repairs
from cnca.world.builtin.site import Pose, Site
from cnca.world.builtin.traffic import put_vehicle
from cnca.world.model import Place, World

HALF = 32.5
"""Half the length of the rows, metres."""
WIDE, DEEP, AISLE = 2.5, 5.0, 6.5
"""A bay's width and depth, and an aisle's width, metres."""
ISLAND = 1.8
"""Width of the planted strip between two rows that meet."""
LANES = ((ISLAND + AISLE) / 2 + DEEP, -(ISLAND + AISLE) / 2 - DEEP)
"""y of the middles of both aisles."""
EDGE = ISLAND / 2 + 2 * DEEP + AISLE
FREE = 10.5
"""Half the length of the stretch of the first aisle around which bays stay empty."""


def build(rng: np.random.Generator) -> World:
    """Two aisles with bays on both sides; the usual place stands in the first aisle."""
    site, origin = Site(), Pose()
    ground = (-HALF - AISLE, HALF + AISLE)
    site.add("asphalt", area(rng, ground, (-EDGE, EDGE)), origin)
    repairs(site, rng, origin, ground, (LANES[0] - 3.0, LANES[0] + 3.0))
    repairs(site, rng, origin, ground, (LANES[1] - 3.0, LANES[1] + 3.0))
    for y in LANES:
        for side in (0.0, 180.0):
            _row(site, rng, origin.then(0.0, y, side), usual=y == LANES[0])
        for x, turn in ((-12.0, 0.0), (12.0, 180.0)):
            lane = -1.5 if turn == 0.0 else 1.5
            mark = arrow(rng, -2.5, 0.0)
            site.add("marking", mark, origin.then(x, y + lane, turn))
    _island(site, rng, origin)
    _surroundings(site, rng, origin)
    put_vehicle(site, rng, origin.then(-HALF + 8.0, LANES[1] - 1.5, rng.normal(0, 2)), drives=True)
    put_vehicle(
        site, rng, origin.then(HALF - 6.0, LANES[0] + 1.5, 180.0 + rng.normal(0, 2)), drives=True
    )
    site.add("grass", rectangle((-300.0, 300.0), (-300.0, 300.0), -0.06), origin)
    return site.world("builtin:car_park", _places(site))


def _row(site: Site, rng: np.random.Generator, pose: Pose, *, usual: bool) -> None:
    """Bays on the side y > 0 of an aisle along the pose's x."""
    near, far = AISLE / 2, AISLE / 2 + DEEP
    for x in np.arange(-HALF, HALF + 0.1, WIDE):
        site.add("marking", bar(rng, float(x), (near, far - 0.1), 0.1), pose)
    site.add("marking", line(rng, (-HALF, HALF), far - 0.1, 0.1), pose)
    for x in np.arange(-HALF, HALF - 0.1, WIDE) + WIDE / 2:
        if (usual and abs(x) < FREE) or rng.random() > 0.24:
            continue
        turn = 90.0 if rng.random() < 0.6 else -90.0
        middle = (near + far) / 2 + rng.normal(0, 0.12)
        at = pose.then(float(x) + rng.normal(0, 0.08), middle, turn + rng.normal(0, 1.5))
        put_vehicle(site, rng, at)


def _island(site: Site, rng: np.random.Generator, pose: Pose) -> None:
    """The planted strip in the middle, with trees and lamps off the usual place."""
    half = ISLAND / 2
    for side, span in ((pose, (-HALF, HALF)), (pose.then(0, 0, 180.0), (-HALF, HALF))):
        site.add("kerb", kerb(span, half - 0.15, -1), side.then(0.0, 0.15))
    site.add("grass", rectangle((-HALF, HALF), (-half + 0.15, half - 0.15), KERB - 0.02), pose)
    for number, x in enumerate(np.arange(-HALF + 3.0, HALF - 1.0, 6.0)):
        at = pose.then(float(x), 0.0, up=KERB - 0.02)
        if number % 3 == 1:
            street_lamp(site, at, 6.5, 1.4)
            street_lamp(site, at.then(0.0, 0.0, 180.0), 6.5, 1.4)
        elif abs(x) > FREE + 2.0:
            tree(site, rng, at, float(rng.uniform(0.6, 0.8)))
        else:
            bush(site, rng, at, float(rng.uniform(0.4, 0.55)))


def _surroundings(site: Site, rng: np.random.Generator, pose: Pose) -> None:
    """The shop behind the far row, hedges and houses on the other sides."""
    front = EDGE + 5.0
    site.add("slabs", rectangle((-HALF - AISLE, HALF + AISLE), (EDGE, front + 0.3), KERB), pose)
    site.add("kerb", kerb((-HALF - AISLE, HALF + AISLE), EDGE, 1), pose)
    shop = _shop_style(rng)
    house(site, rng, pose.then(-24.0, front, up=KERB), shop, 48.0, shop=True, corners=(True, True))
    for x in (-27.0, -31.0, 27.0, 31.0):
        tree(site, rng, pose.then(x, front - 1.5, up=KERB), float(rng.uniform(0.8, 1.1)))
    for turn, reach in ((180.0, HALF + AISLE), (90.0, EDGE + 5.0), (-90.0, EDGE + 5.0)):
        near = EDGE if turn == 180.0 else HALF + AISLE
        side = pose.then(0.0, 0.0, turn)
        site.add("kerb", kerb((-reach, reach), near, 1), side)
        site.add("grass", rectangle((-reach, reach), (near + 0.15, near + 14.0), KERB - 0.02), side)
        for x in np.arange(-reach, reach - 4.0, 8.0):
            at = side.then(float(x), near + 1.0, up=KERB)
            if rng.random() < 0.6:
                hedge(site, rng, at, 7.5, 0.8)
            else:
                picket_fence(site, at, 7.8)
            if rng.random() < 0.7:
                spot = side.then(float(x) + 4.0, near + float(rng.uniform(3.0, 8.0)), up=KERB)
                tree(site, rng, spot, float(rng.uniform(0.8, 1.15)))
        end_row(site, rng, side.then(0.0, near + 18.0), reach + 14.0)
    for x, kind in ((-HALF + 2.0, "parking"), (HALF - 2.0, "speed")):
        traffic_sign(site, pose.then(x, EDGE + 0.6, 0.0, KERB), kind)


def _shop_style(rng: np.random.Generator) -> Style:
    style = draw_style(rng)
    wall = str(rng.choice(["concrete", "plaster_4", "brick_brown"]))
    return replace(
        style,
        wall=wall,
        base=wall,
        trim="zinc",
        frame="frame_dark",
        window=(2.2, 1.1),
        bay=3.4,
        storeys=1,
        ground_floor=4.4,
        balconies=False,
        lintels=False,
    )


def _places(site: Site) -> list[Place]:
    """Both aisles, right of their middles, and bays whose neighbors are empty."""
    places = [Place(0.0, LANES[0] - 1.5)]
    for y in LANES:
        for x in np.arange(-HALF + 3.0, HALF, 4.0):
            for lane, heading in ((-1.5, 0.0), (1.5, 180.0)):
                place = Place(float(x), y + lane, 0.0, heading)
                if site.free(place, 4.9):
                    places.append(place)
        for x in np.arange(-HALF, HALF - 0.1, WIDE) + WIDE / 2:
            for side in (-1, 1):
                bay = Place(float(x), y + side * ((AISLE + DEEP) / 2 - 0.15), 0.0, -90.0 * side)
                if site.free(bay, 4.5):
                    places.append(bay)
    return places
