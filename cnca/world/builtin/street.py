"""``builtin:street``: a straight street of two lanes with houses on both sides."""

from __future__ import annotations

import numpy as np

from cnca.world.builtin.block import Block, build_block, end_row
from cnca.world.builtin.meshes import rectangle
from cnca.world.builtin.roads import LANE, area, arrow, bar, dashes, zebra
from cnca.world.builtin.site import Pose, Site
from cnca.world.builtin.traffic import put_vehicle
from cnca.world.model import Place, World

HALF = 92.0
"""Half the street's length, metres."""
JUNCTION = 9.0
"""Width of the carriageway that crosses it at both ends, metres."""
CLEAR = ((-15.0, 15.0), (-66.0, -46.0), (46.0, 66.0))
"""Stretches that are kept clear: around the usual place, and for other places."""


def build(rng: np.random.Generator) -> World:
    """A street along x; the usual place stands in its middle, in the right lane."""
    site, origin = Site(), Pose()
    build_block(site, rng, origin, Block((-HALF, HALF), clear=CLEAR))
    for heading in (0.0, 180.0):
        _end(site, rng, origin.then(0.0, 0.0, heading))
        _moving(site, rng, origin.then(0.0, 0.0, heading))
    site.add("grass", rectangle((-400.0, 400.0), (-400.0, 400.0), -0.06), origin)
    return site.world("builtin:street", places(site, HALF - 12.0))


def _end(site: Site, rng: np.random.Generator, pose: Pose) -> None:
    """The crossing road at x = HALF, with the stop line before it and the houses behind."""
    far = HALF + JUNCTION
    plate = pose.then(far, 0.0, 90.0)
    site.add("asphalt", area(rng, (-60.0, 60.0), (0.0, JUNCTION)), plate)
    site.add("marking", dashes(rng, (6.0, 58.0), JUNCTION / 2), plate)
    site.add("marking", dashes(rng, (-58.0, -6.0), JUNCTION / 2), plate)
    site.add("marking", zebra(rng, (HALF - 4.5, HALF - 1.0), (-LANE, LANE)), pose)
    site.add("marking", bar(rng, HALF - 5.8, (-LANE, -0.1)), pose)
    site.add("marking", arrow(rng, HALF - 16.0, -LANE / 2), pose)
    end_row(site, rng, pose.then(far + 4.15, 0.0, -90.0), 50.0)


def _moving(site: Site, rng: np.random.Generator, pose: Pose) -> None:
    """Cars in the lane that heads along +x, apart from the usual place."""
    x = -HALF + float(rng.uniform(3.0, 12.0))
    while x < HALF - 8.0:
        if not any(low - 3.0 < x < high + 3.0 for low, high in CLEAR):
            y = -LANE / 2 + rng.normal(0, 0.12)
            put_vehicle(site, rng, pose.then(x, y, rng.normal(0, 0.6)), drives=True)
        x += float(rng.uniform(10.0, 22.0))


def places(site: Site, reach: float) -> list[Place]:
    """Free places in both lanes, the usual one first."""
    free = [Place(0.0, -LANE / 2)]
    for x in np.arange(-reach, reach + 1.0, 5.0):
        for y, heading in ((-LANE / 2, 0.0), (LANE / 2, 180.0)):
            place = Place(float(x), y, 0.0, heading)
            if site.free(place, 8.0) and abs(x) > 3.0:
                free.append(place)
    return free
