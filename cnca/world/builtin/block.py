"""A stretch of street between two crossings: carriageway, parking, trees, pavements, houses."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cnca.world.builtin.furniture import (
    bench,
    bin_,
    bollards,
    hanging_lamp,
    picket_fence,
    planter,
    railing,
    street_lamp,
    traffic_sign,
    wheelie_bin,
)
from cnca.world.builtin.houses import DEPTH, draw_style, house
from cnca.world.builtin.meshes import rectangle
from cnca.world.builtin.plants import bush, hedge, tree
from cnca.world.builtin.roads import KERB, LANE, Span, bar, dashes, kerb, lane, line, repairs
from cnca.world.builtin.site import Pose, Site
from cnca.world.builtin.traffic import put_vehicle

PARKING = LANE + 2.2
"""Distance of the kerb from the middle of the road, metres."""
STRIP = PARKING + 2.4
"""Where the strip with trees ends and the pavement begins."""
PAVEMENT = STRIP + 3.6
"""Where the pavement ends and gardens begin."""
FACADES = PAVEMENT + 5.6
HANGING = 14.0
"""Metres between lamps on wires, where posts would hide what stands on the road."""
BAY = 5.7
"""Length of a parking bay along the kerb, metres."""


@dataclass(frozen=True)
class Block:
    """A stretch along x of a pose; traffic keeps to the right."""

    x: Span
    clear: tuple[Span, ...] = ()
    """Where neither trees nor lamps nor parked cars may hide what stands on the road."""
    shops: float = 0.45
    """Share of houses with a shop."""
    storeys: tuple[int, int] = (2, 5)
    """Fewest and most storeys above the ground floor."""
    parked: float = 0.48
    """Share of the bays outside of the clear stretches that are taken."""
    houses: tuple[Span, Span] | None = None
    """Where houses stand on the left and on the right for one who looks along x; None is all."""

    def turned(self) -> Block:
        """The same stretch for one who looks the other way."""
        houses = self.houses and (_mirrored(self.houses[1]), _mirrored(self.houses[0]))
        clear = tuple(_mirrored(span) for span in self.clear)
        return replace(self, x=_mirrored(self.x), clear=clear, houses=houses)

    def is_clear(self, x: float, margin: float = 0.0) -> bool:
        """Whether x lies in a stretch that is to be kept clear, or ``margin`` metres from one."""
        return any(a - margin < x < b + margin for a, b in self.clear)


def _mirrored(span: Span) -> Span:
    return -span[1], -span[0]


def build_block(site: Site, rng: np.random.Generator, pose: Pose, block: Block) -> None:
    """Both sides of a street without its moving traffic."""
    half(site, rng, pose, block)
    half(site, rng, pose.then(0.0, 0.0, 180.0), block.turned())
    site.add("marking", dashes(rng, (block.x[0] + 7, block.x[1] - 7), 0.0), pose)
    for low, high in block.clear:
        for x in np.linspace(low, high, 2 + int((high - low) // HANGING))[1:-1]:
            hanging_lamp(site, pose.then(float(x), 0.0), FACADES)


def half(site: Site, rng: np.random.Generator, pose: Pose, block: Block) -> None:
    """The side y > 0 of a street, whose traffic heads towards −x."""
    x = block.x
    site.add("asphalt", lane(rng, x, (0.0, LANE)), pose)
    repairs(site, rng, pose, x, (0.0, LANE))
    _parking(site, rng, pose, block)
    site.add("kerb", kerb(x, PARKING, 1), pose)
    _strip(site, rng, pose, block)
    offset = tuple(rng.uniform(0, 4.8, 2))
    site.add("slabs", rectangle(x, (STRIP, PAVEMENT), KERB, offset), pose)
    _houses(site, rng, pose, block)


def _parking(site: Site, rng: np.random.Generator, pose: Pose, block: Block) -> None:
    x = block.x
    if rng.random() < 0.4:
        site.add("setts", rectangle(x, (LANE, PARKING), 0.0), pose)
    else:
        site.add("asphalt", lane(rng, x, (LANE, PARKING)), pose)
    site.add("marking", line(rng, x, LANE), pose)
    ends = np.arange(x[0] + 6.0, x[1] - 5.9, BAY)
    for end in ends:
        site.add("marking", bar(rng, float(end), (LANE + 0.06, PARKING - 0.1), 0.1), pose)
    for end in ends[:-1]:
        middle = float(end + BAY / 2 + rng.normal(0, 0.12))
        if block.is_clear(middle, 3.0) or rng.random() > block.parked:
            continue
        turn = 180.0 if rng.random() < 0.93 else 0.0
        y = (LANE + PARKING) / 2 + 0.08 + rng.normal(0, 0.06)
        put_vehicle(site, rng, pose.then(middle, y, turn + rng.normal(0, 1.0)))


def _strip(site: Site, rng: np.random.Generator, pose: Pose, block: Block) -> None:
    """Trees and lamps in turn, on grass or in pits; bins, signs and benches between them."""
    x, middle = block.x, (PARKING + 0.15 + STRIP) / 2
    on_grass = rng.random() < 0.5
    surface = "grass" if on_grass else "slabs"
    site.add(surface, rectangle(x, (PARKING + 0.15, STRIP), KERB - 0.004), pose)
    step = float(rng.uniform(9.0, 11.0))
    for number, start in enumerate(np.arange(x[0] + 5.0, x[1] - 3.0, step)):
        at = float(start + rng.uniform(-0.7, 0.7))
        if block.is_clear(at, 2.5):
            continue
        if number % 3 == 1:
            street_lamp(site, pose.then(at, PARKING + 0.6, up=KERB), reach=2.2)
        else:
            if not on_grass:
                pit = rectangle((at - 0.7, at + 0.7), (middle - 0.7, middle + 0.7), KERB + 0.004)
                site.add("soil", pit, pose)
            tree(site, rng, pose.then(at, middle, up=KERB), float(rng.uniform(0.85, 1.15)))
        _between(site, rng, pose.then(at + step / 2, 0.0, up=KERB), middle)
    for at, kind in ((x[1] - 9.0, "no_parking"), (x[1] - 4.0, "speed"), (x[0] + 7.0, "parking")):
        traffic_sign(site, pose.then(at, PARKING + 0.7, 90.0, KERB), kind)


def _between(site: Site, rng: np.random.Generator, pose: Pose, y: float) -> None:
    """Perhaps something small between two trees."""
    kind = rng.choice(["none", "bin", "bench", "bollards"], p=[0.4, 0.25, 0.2, 0.15])
    if kind == "bin":
        bin_(site, pose.then(0.0, y))
    elif kind == "bench":
        bench(site, pose.then(0.0, y + 0.5, 180.0))
    elif kind == "bollards":
        bollards(site, pose.then(-1.6, PARKING + 0.5), 3.2)


def _houses(site: Site, rng: np.random.Generator, pose: Pose, block: Block) -> None:
    left, right = first, last = block.houses[0] if block.houses else block.x
    while right - left > 1e-6:
        width = float(rng.uniform(10.0, 19.0))
        if right - left - width < 10.0:
            width = right - left
        style = draw_style(rng)
        style = replace(style, storeys=int(np.clip(style.storeys, *block.storeys)))
        setback = float(rng.choice([0.0, 0.0, 0.3]))
        foot = pose.then(left, FACADES + setback, up=KERB)
        corners = (left == first, left + width >= last)
        shop = bool(rng.random() < block.shops)
        door = house(site, rng, foot, style, width, shop=shop, corners=corners)
        _forecourt(site, rng, pose.then(left, 0.0, up=KERB), width, door)
        left += width


def _forecourt(
    site: Site, rng: np.random.Generator, pose: Pose, width: float, door: float | None
) -> None:
    """The ground between pavement and façade: paved before shops, else a garden with a path."""
    depth = (PAVEMENT, FACADES + 0.4)
    if door is None:
        site.add("slabs", rectangle((0.0, width), depth, 0.0, tuple(rng.uniform(0, 4.8, 2))), pose)
        for _ in range(int(rng.integers(0, 3))):
            at = pose.then(
                rng.uniform(1.0, width - 2.5), rng.uniform(PAVEMENT + 1.0, FACADES - 2.0)
            )
            planter(site, at)
            bush(site, rng, at.then(0.6, 0.0, up=0.3), 0.42)
        return
    path = (door - 0.7, door + 0.7)
    site.add("grass", rectangle((0.0, width), depth, -0.01), pose)
    site.add("slabs", rectangle(path, depth, 0.0), pose)
    for a, b in ((0.1, path[0]), (path[1], width - 0.1)):
        if b - a > 1.0:
            _border(site, rng, pose.then(a, PAVEMENT + 0.3), b - a)
            for _ in range(rng.poisson((b - a) / 4)):
                at = pose.then(
                    rng.uniform(a + 0.5, b - 0.5), rng.uniform(PAVEMENT + 1.3, FACADES - 0.6)
                )
                bush(site, rng, at, float(rng.uniform(0.3, 0.6)))
    if rng.random() < 0.4:
        wheelie_bin(site, pose.then(path[1] + 0.6, FACADES - 0.9))


def _border(site: Site, rng: np.random.Generator, pose: Pose, length: float) -> None:
    kind = rng.choice(["hedge", "railing", "fence"], p=[0.5, 0.3, 0.2])
    if kind == "hedge":
        hedge(site, rng, pose, length, float(rng.uniform(0.7, 1.0)))
    elif kind == "railing":
        railing(site, pose, length)
    else:
        picket_fence(site, pose, length)


def end_row(site: Site, rng: np.random.Generator, pose: Pose, half_length: float) -> None:
    """Houses that close a street: along the pose's x, their façades facing −y."""
    left = -half_length
    while left < half_length - 1e-6:
        width = min(float(rng.uniform(11.0, 18.0)), half_length - left)
        shop = bool(rng.random() < 0.6)
        house(site, rng, pose.then(left, 0.0, up=KERB), draw_style(rng), width, shop=shop)
        left += width
    site.add("slabs", rectangle((-half_length, half_length), (-4.0, 0.4), KERB), pose)
    site.add("kerb", kerb((-half_length, half_length), -4.15, 1), pose)
    for at in np.arange(-half_length + 6.0, half_length, 14.0):
        tree(site, rng, pose.then(float(at), -2.8, up=KERB))


BACK = FACADES + DEPTH
"""Distance of the houses' backs from the middle of the road, metres."""
