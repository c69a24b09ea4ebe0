"""``builtin:crossing``: two streets that cross, with signals, zebra crossings and queues."""

from __future__ import annotations

import itertools

import numpy as np

from cnca.world.builtin.block import (
    BACK,
    FACADES,
    PARKING,
    PAVEMENT,
    Block,
    build_block,
    end_row,
)
from cnca.world.builtin.furniture import bollards, street_lamp, traffic_light
from cnca.world.builtin.meshes import Mesh, quads, rectangle
from cnca.world.builtin.roads import KERB, LANE, area, arrow, bar, lane, line, round_kerb, zebra
from cnca.world.builtin.roads import kerb as straight_kerb
from cnca.world.builtin.site import Pose, Site
from cnca.world.builtin.traffic import put_vehicle
from cnca.world.model import Place, World

RADIUS = 6.0
"""Radius of the kerb around the corners, metres."""
MOUTH = PARKING + RADIUS
"""Where the corners' curves end and the arms begin, metres from the middle."""
STOP = MOUTH + 6.3
"""Where traffic stops."""
END = 86.0


def build(rng: np.random.Generator) -> World:
    """Four arms; the usual place stands in the middle of the crossing."""
    site, origin = Site(), Pose()
    site.add("asphalt", area(rng, (-MOUTH, MOUTH), (-MOUTH, MOUTH)), origin)
    gap = FACADES + 0.4
    for heading in (0.0, 90.0, 180.0, 270.0):
        arm = origin.then(0.0, 0.0, heading)
        across = heading in (90.0, 270.0)
        start = gap if across else MOUTH
        first, second = (FACADES, END), (BACK + 0.3, END)
        houses = (second, second) if across else (first, first)
        clear = ((start, STOP + 4.0), (60.0, 72.0))
        block = Block((start, END), clear, shops=0.6, parked=0.3, houses=houses)
        build_block(site, rng, arm, block)
        if across:
            _mouth(site, rng, arm, gap)
        _corner(site, rng, arm)
        _markings(site, rng, arm)
        _traffic(site, rng, arm, waits=across)
        _end(site, rng, arm)
    site.add("grass", rectangle((-300.0, 300.0), (-300.0, 300.0), -0.06), origin)
    return site.world("builtin:crossing", _places(site))


def _mouth(site: Site, rng: np.random.Generator, arm: Pose, gap: float) -> None:
    """The carriageway between the corners' curves and where this arm's block begins."""
    x = (MOUTH, gap)
    for side in (arm, arm.then(0.0, 0.0, 180.0)):
        span = x if side is arm else (-gap, -MOUTH)
        site.add("asphalt", lane(rng, span, (0.0, LANE)), side)
        site.add("asphalt", lane(rng, span, (LANE, PARKING)), side)
        site.add("kerb", straight_kerb(span, PARKING, 1), side)
        site.add("slabs", rectangle(span, (PARKING + 0.15, MOUTH), KERB), side)


def _corner(site: Site, rng: np.random.Generator, arm: Pose) -> None:
    """Pavement between this arm's left side and the next arm's right side, with its kerb."""
    centre = (MOUTH, MOUTH)
    site.add("kerb", round_kerb(centre, RADIUS, 180.0), arm)
    site.add("slabs", _fan(centre, RADIUS - 0.15), arm)
    far = FACADES + 0.4
    # This arm's strips begin at MOUTH; beside them only the corner before the houses is bare.
    if round(arm.heading) % 180 == 0:
        site.add("slabs", rectangle((MOUTH, FACADES), (PAVEMENT, far), KERB), arm)
        site.add("slabs", rectangle((MOUTH, FACADES), (-far, -PAVEMENT), KERB), arm)
    else:
        bare = (far, BACK + 0.3)
        site.add("slabs", rectangle(bare, (PAVEMENT, far), KERB), arm)
        site.add("slabs", rectangle(bare, (-far, -PAVEMENT), KERB), arm)
    street_lamp(site, arm.then(PARKING + 3.2, PARKING + 3.2, -45.0, KERB), 8.0, 2.5)
    bollards(site, arm.then(MOUTH + 6.5, PARKING + 0.6, up=KERB), 3.2)


def _fan(centre: tuple[float, float], radius: float) -> Mesh:
    """A quarter of a disc towards −x and −y of its center."""
    angle = np.radians(np.linspace(180.0, 270.0, 10))
    rim = np.asarray(centre) + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    corners = [
        [[*centre, KERB], [*a, KERB], [*b, KERB], [*b, KERB]] for a, b in itertools.pairwise(rim)
    ]
    mesh = quads(np.array(corners))
    return Mesh(mesh.vertices, mesh.faces, mesh.normals, mesh.vertices[:, :2].copy())


def _markings(site: Site, rng: np.random.Generator, arm: Pose) -> None:
    site.add("marking", zebra(rng, (STOP - 5.0, STOP - 1.5), (-PARKING + 0.2, PARKING - 0.2)), arm)
    site.add("marking", bar(rng, STOP, (0.1, LANE)), arm)
    site.add("marking", line(rng, (STOP, STOP + 8.0), 0.0), arm)
    turn = int(rng.integers(-1, 2))
    site.add("marking", arrow(rng, -STOP - 9.0, -LANE / 2, turn), arm.then(0.0, 0.0, 180.0))
    traffic_light(site, arm.then(STOP, PARKING + 0.6, 90.0, KERB))


def _traffic(site: Site, rng: np.random.Generator, arm: Pose, *, waits: bool) -> None:
    """A queue before the stop line of a red arm; else cars on their way, both ways."""
    if waits:
        x = STOP + 0.8
        for _ in range(int(rng.integers(1, 4))):
            put_vehicle(
                site, rng, arm.then(x + 2.4, LANE / 2 + rng.normal(0, 0.1), 180.0), drives=True
            )
            x += float(rng.uniform(6.2, 7.5))
    else:
        x = float(rng.uniform(26.0, 34.0))
        put_vehicle(site, rng, arm.then(x, LANE / 2, 180.0 + rng.normal(0, 0.5)), drives=True)
    x = float(rng.uniform(34.0, 44.0))
    put_vehicle(site, rng, arm.then(x, -LANE / 2, rng.normal(0, 0.5)), drives=True)


def _end(site: Site, rng: np.random.Generator, arm: Pose) -> None:
    """A cross road and houses that close the arm."""
    plate = arm.then(END + 9.0, 0.0, 90.0)
    site.add("asphalt", area(rng, (-30.0, 30.0), (0.0, 9.0)), plate)
    end_row(site, rng, arm.then(END + 13.15, 0.0, -90.0), 30.0)


def _places(site: Site) -> list[Place]:
    """The middle of the crossing, then free places on all arms."""
    places = [Place(-2.0, -LANE / 2)]
    for heading in (0.0, 90.0, 180.0, 270.0):
        arm = Pose(0.0, 0.0, heading)
        for x in np.arange(-7.0, 76.0, 4.5):
            for y, turn in ((-LANE / 2, 0.0), (LANE / 2, 180.0)):
                place = Place(*arm.point(float(x), y), 0.0, heading + turn)
                if abs(x) > STOP and site.free(place, 8.0):
                    places.append(place)
    return places
