"""Carriageways: asphalt in pieces that do not repeat, markings, repairs, manholes, kerbs."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from cnca.world.builtin.ground_pictures import LANE_STRIPS
from cnca.world.builtin.meshes import Mesh, box, disc, merge, quads, rectangle, ribbon
from cnca.world.builtin.site import Pose, Site

LANE = 3.25
"""Width of a lane, metres."""
KERB = 0.12
"""Height of the kerb and of the pavement behind it, metres."""
PIECE = 13.0
"""Length of a lane's picture, metres."""
REPAIRS, SEALS, PAINT = 0.005, 0.0065, 0.008
"""Heights of what lies on the asphalt, in the order in which it was laid: nothing coincides."""
Span = tuple[float, float]


def lane(rng: np.random.Generator, x: Span, y: Span, z: float = 0.0) -> Mesh:
    """A strip of asphalt along x with one lane's wear, of randomly chosen pieces."""
    edges = np.append(np.arange(x[0], x[1] - 0.5, PIECE), x[1])
    corners, uvs = [], []
    for left, right in itertools.pairwise(edges):
        strip = int(rng.integers(LANE_STRIPS))
        low, high = LANE * strip + 0.03, LANE * (strip + 1) - 0.03
        if rng.random() < 0.5:
            low, high = high, low
        near, far = 0.0, right - left
        if rng.random() < 0.5:
            near, far = PIECE, PIECE - far
        corners.append([[left, y[0], z], [right, y[0], z], [right, y[1], z], [left, y[1], z]])
        uvs.append([[near, low], [far, low], [far, high], [near, high]])
    return quads(np.array(corners), np.array(uvs))


def area(rng: np.random.Generator, x: Span, y: Span, z: float = 0.0) -> Mesh:
    """A rectangle of asphalt, in strips along x of about a lane's width."""
    count = max(1, round((y[1] - y[0]) / LANE))
    edges = np.linspace(*y, count + 1)
    return merge([lane(rng, x, pair, z) for pair in itertools.pairwise(edges)])


def line(rng: np.random.Generator, x: Span, y: float, width: float = 0.12) -> Mesh:
    """A painted line along x."""
    return _paint(rng, x, (y - width / 2, y + width / 2))


def dashes(
    rng: np.random.Generator,
    x: Span,
    y: float,
    length: float = 3.0,
    gap: float = 6.0,
    width: float = 0.12,
) -> Mesh:
    """A broken line along x."""
    starts = np.arange(x[0], x[1] - length + 1e-6, length + gap)
    return merge([line(rng, (start, start + length), y, width) for start in starts])


def zebra(rng: np.random.Generator, x: Span, y: Span) -> Mesh:
    """A pedestrian crossing: bars along x, half a metre wide, from kerb to kerb."""
    count = int((y[1] - y[0] - 0.5) // 1.0) + 1
    first = (y[0] + y[1] - (count - 0.5)) / 2
    return merge([_paint(rng, x, (first + i, first + i + 0.5)) for i in range(count)])


def bar(rng: np.random.Generator, x: float, y: Span, width: float = 0.5) -> Mesh:
    """A line across the road: where to stop, or where a parking bay ends."""
    return _paint(rng, (x - width / 2, x + width / 2), y)


def arrow(rng: np.random.Generator, x: float, y: float, turn: int = 0) -> Mesh:
    """An arrow of 5 m that points along +x, or to the left (1) or the right (−1) as well."""
    shaft = [[x, y - 0.08], [x + 3.4, y - 0.08], [x + 3.4, y + 0.08], [x, y + 0.08]]
    head = [[x + 3.4, y - 0.32], [x + 5.0, y], [x + 5.0, y], [x + 3.4, y + 0.32]]
    shapes = [shaft, head]
    if turn:
        foot, side = x + 1.2, float(turn)
        bend = [
            [foot, y],
            [foot + 0.9, y + 0.5 * side],
            [foot + 1.1, y + 0.5 * side],
            [foot + 0.3, y],
        ]
        tip = [
            [foot + 0.5, y + 0.45 * side],
            [foot + 1.5, y + 0.95 * side],
            [foot + 1.5, y + 0.95 * side],
            [foot + 1.6, y + 0.4 * side],
        ]
        # Mirrored outlines run the other way round.
        shapes += [bend[:: turn * -1], tip[:: turn * -1]]
    flat = np.array(shapes)
    corners = np.concatenate([flat, np.full((*flat.shape[:2], 1), PAINT)], axis=-1)
    return quads(corners, corners[..., :2] + rng.uniform(0, 2, 2))


def _paint(rng: np.random.Generator, x: Span, y: Span) -> Mesh:
    u, v = rng.uniform(0, 2, 2)
    return rectangle(x, y, PAINT, offset=(u, v))


def repairs(site: Site, rng: np.random.Generator, pose: Pose, x: Span, y: Span) -> None:
    """Patches with sealed joints, wandering seals of tar and manholes on a carriageway."""
    length = x[1] - x[0]
    for _ in range(rng.poisson(length / 22)):
        _patch(site, rng, pose, x, y)
    for _ in range(rng.poisson(length / 14)):
        start = np.array([rng.uniform(*x), rng.uniform(y[0] + 0.5, y[1] - 0.5)])
        path = _wander(rng, start, rng.choice([0.0, np.pi / 2], p=[0.65, 0.35]))
        inside = (path[:, 0] > x[0]) & (path[:, 0] < x[1])
        inside &= (path[:, 1] > y[0] + 0.1) & (path[:, 1] < y[1] - 0.1)
        path = path[: len(path) if inside.all() else int(np.argmin(inside))]
        if len(path) > 4:
            width = rng.uniform(0.02, 0.06) * rng.uniform(0.6, 1.2, len(path))
            site.add("tar", ribbon(path, width, SEALS), pose)
    for _ in range(rng.poisson(length / 30)):
        centre = (rng.uniform(*x), y[0] + (y[1] - y[0]) * rng.uniform(0.2, 0.8))
        site.add("asphalt_new", disc((*centre, SEALS), 0.52, 20), pose)
        site.add("iron", disc((*centre, SEALS + 0.003), 0.33, 20), pose)


def _patch(site: Site, rng: np.random.Generator, pose: Pose, x: Span, y: Span) -> None:
    long, wide = rng.uniform(1.0, 5.0), rng.uniform(0.7, 2.4)
    a = rng.uniform(x[0], max(x[0], x[1] - long))
    c = rng.uniform(y[0] + 0.1, max(y[0] + 0.1, y[1] - wide - 0.1))
    b, d = min(a + long, x[1]), min(c + wide, y[1] - 0.05)
    surface = rng.choice(["asphalt_new", "asphalt_old"], p=[0.7, 0.3])
    offset = tuple(rng.uniform(0, 13, 2))
    site.add(str(surface), rectangle((a, b), (c, d), REPAIRS, offset=offset), pose)
    outline = np.array([[a, c], [b, c], [b, d], [a, d], [a, c]])
    for start, end in itertools.pairwise(outline):
        path = start + (end - start) * np.linspace(0, 1, 6)[:, None]
        path = path + 0.01 * rng.standard_normal(path.shape)
        site.add("tar", ribbon(path, rng.uniform(0.02, 0.05, 6), SEALS), pose)


def _wander(rng: np.random.Generator, start: np.ndarray, heading: float) -> np.ndarray:
    """A path of up to 8 m that keeps its direction more or less."""
    steps = int(rng.integers(8, 32))
    turn = heading + np.clip(0.3 * rng.standard_normal(steps).cumsum(), -0.9, 0.9)
    turn = turn + 0.35 * rng.standard_normal(steps)
    return start + 0.25 * np.stack([np.cos(turn), np.sin(turn)], axis=1).cumsum(axis=0)


def kerb(x: Span, y: float, side: int) -> Mesh:
    """A kerb along x with its face at ``y``; the pavement lies on its ``side`` (±1)."""
    low, high = sorted((y, y + 0.15 * side))
    return box((x[0], low, -0.05), (x[1], high, KERB), sides="-y+y+z-x+x")


def round_kerb(centre: Sequence[float], radius: float, start: float) -> Mesh:
    """A quarter of a ring of kerb stones around ``centre``, from ``start`` degrees onwards."""
    angle = np.radians(start + np.linspace(0, 90, 9))
    spokes = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    outer, inner = (
        np.asarray(centre) + radius * spokes,
        np.asarray(centre) + (radius - 0.15) * spokes,
    )
    corners = []
    for i in range(8):
        a, b, c, d = outer[i], outer[i + 1], inner[i + 1], inner[i]
        corners.append([[*a, -0.05], [*b, -0.05], [*b, KERB], [*a, KERB]])
        corners.append([[*a, KERB], [*b, KERB], [*c, KERB], [*d, KERB]])
    return quads(np.array(corners))
