"""Walls with recessed windows, doors and shop fronts.

A façade stands in the plane y = 0 of its own axes, x to the right for one who looks at it, and
its outside is −y.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cnca.world.builtin.glazing_pictures import NAMES, ROOMS, SHOPS
from cnca.world.builtin.meshes import Mesh, box, merge, quads, repeat
from cnca.world.builtin.site import Pose, Site

RECESS = 0.14
"""How far panes lie behind the wall, metres."""
Span = tuple[float, float]


@dataclass(frozen=True)
class Style:
    """What all windows and walls of one house share."""

    wall: str
    base: str
    """Surface of the ground floor."""
    frame: str
    trim: str
    """Surface of sills, cornices and lintels."""
    window: tuple[float, float]
    """Width and height in metres."""
    bay: float
    """Distance between the middles of two windows, metres."""
    storey: float = 3.0
    ground_floor: float = 3.7
    storeys: int = 4
    """Above the ground floor."""
    balconies: bool = False
    lintels: bool = False


def bays(style: Style, width: float) -> np.ndarray:
    """x of the windows' middles."""
    count = max(1, int((width - 0.8) // style.bay))
    return width / 2 + style.bay * (np.arange(count) - (count - 1) / 2)


def wall(x: Span, z: Span, holes: list[tuple[Span, Span]]) -> Mesh:
    """A wall with rectangular holes, (x span, z span) each."""
    columns = np.unique([*x, *(edge for hole in holes for edge in hole[0])])
    rows = np.unique([*z, *(edge for hole in holes for edge in hole[1])])
    corners = []
    for low, high in itertools.pairwise(rows):
        middle = (low + high) / 2
        open_here = [hole[0] for hole in holes if hole[1][0] < middle < hole[1][1]]
        start = None
        for a, b in itertools.pairwise(columns):
            is_hole = any(left < (a + b) / 2 < right for left, right in open_here)
            if is_hole and start is not None:
                corners.append(_upright((start, a), (low, high)))
                start = None
            elif not is_hole and start is None:
                start = a
        if start is not None:
            corners.append(_upright((start, columns[-1]), (low, high)))
    return quads(np.array(corners))


def windows(
    site: Site,
    rng: np.random.Generator,
    pose: Pose,
    style: Style,
    feet: Float[np.ndarray, "windows 2"],
    size: tuple[float, float],
) -> None:
    """Windows of one size with their lower left corners at ``feet`` (x, z): panes with pictures,
    frames, reveals and sills.
    """
    if not len(feet):
        return
    offsets = np.stack([feet[:, 0], 0 * feet[:, 0], feet[:, 1]], axis=-1)
    x, z = (0.0, size[0]), (0.0, size[1])
    cells = rng.integers((ROOMS[1], ROOMS[0]), size=(len(feet), 2))
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    uvs = (cells[:, None] + 0.01 + 0.98 * corners) / (ROOMS[1], ROOMS[0])
    glass = offsets[:, None] + np.array(_upright(x, z, RECESS))
    site.add("pane", quads(glass, uvs), pose)
    sill = [box((-0.06, -0.07, -0.07), (x[1] + 0.06, RECESS, 0.0), sides="-x+x-y+z-z")]
    if style.lintels:
        low, high = (-0.12, -0.05, z[1]), (x[1] + 0.12, 0.0, z[1] + 0.2)
        sill.append(box(low, high, sides="-x+x-y+z-z"))
    for surface, mesh in (
        (style.wall, reveal(x, z)),
        (style.frame, _frame(x, z, mullion=size[0] > 0.9)),
        (style.trim, merge(sill)),
    ):
        site.add(surface, repeat(mesh, offsets), pose)


def reveal(x: Span, z: Span, depth: float = RECESS) -> Mesh:
    """The four sides of an opening."""
    (a, b), (c, d) = x, z
    return quads(
        np.array(
            [
                [[a, 0, c], [a, depth, c], [a, depth, d], [a, 0, d]],
                [[b, depth, c], [b, 0, c], [b, 0, d], [b, depth, d]],
                [[a, depth, d], [b, depth, d], [b, 0, d], [a, 0, d]],
                [[a, 0, c], [b, 0, c], [b, depth, c], [a, depth, c]],
            ],
            dtype=float,
        )
    )


def _frame(x: Span, z: Span, *, mullion: bool, bar: float = 0.07, depth: float = RECESS) -> Mesh:
    """Flat bars 3 cm in front of the pane, with a post in the middle."""
    (a, b), (c, d) = x, z
    spans = [((a, b), (c, c + bar)), ((a, b), (d - bar, d))]
    spans += [((a, a + bar), (c + bar, d - bar)), ((b - bar, b), (c + bar, d - bar))]
    if mullion:
        middle = (a + b) / 2
        spans.append(((middle - bar / 2, middle + bar / 2), (c + bar, d - bar)))
    return quads(np.array([_upright(*span, depth - 0.03) for span in spans]))


def shop_front(
    site: Site, rng: np.random.Generator, pose: Pose, style: Style, x: Span, height: float
) -> None:
    """A ground floor of glass with a board above it, and perhaps an awning."""
    top = height - 0.85
    doors = x[0] + (x[1] - x[0]) * rng.choice([0.08, 0.5, 0.92])
    door = (float(np.clip(doors - 0.55, x[0], x[1] - 1.1)),) * 2
    door = (door[0], door[0] + 1.1)
    panes = [(x[0], door[0]), (door[1], x[1])]
    holes = [(door, (0.0, top))]
    for span in panes:
        if span[1] - span[0] < 0.5:
            continue
        count = max(1, round((span[1] - span[0]) / 2.4))
        edges = np.linspace(*span, count + 1)
        holes += [((a + 0.05, b - 0.05), (0.45, top)) for a, b in itertools.pairwise(edges)]
    site.add(style.base, wall(x, (0.0, height), holes), pose)
    for span, rise in holes:
        site.add(style.base, reveal(span, rise), pose)
        site.add(style.frame, _frame(span, rise, mullion=False), pose)
        u, v = rng.integers(SHOPS[1]) / SHOPS[1], rng.integers(SHOPS[0]) / SHOPS[0]
        part = min(1.0, (span[1] - span[0]) / 2.0) / SHOPS[1]
        corners = np.array([[u, v], [u + part, v], [u + part, v + 0.5], [u, v + 0.5]])
        site.add("display", quads(np.array([_upright(span, rise, RECESS)]), corners[None]), pose)
    _board(site, rng, pose, x, top + 0.12)
    if rng.random() < 0.45:
        color = str(rng.choice(["awning_red", "awning_green", "awning_cream"]))
        site.add(color, _awning((x[0] + 0.1, x[1] - 0.1), top + 0.1), pose)


def _board(site: Site, rng: np.random.Generator, pose: Pose, x: Span, z: float) -> None:
    """The shop's name in the middle of a plain strip of its color."""
    number = int(rng.integers(len(NAMES)))
    low, high = 1 - (number + 1) / len(NAMES), 1 - number / len(NAMES)
    middle, half = (x[0] + x[1]) / 2, min(2.2, (x[1] - x[0]) / 2 - 0.1)
    edges = [x[0] + 0.1, middle - half, middle + half, x[1] - 0.1]
    corners, uvs = [], []
    for i, (left, right) in enumerate([(0.005, 0.01), (0.01, 0.99), (0.99, 0.995)]):
        corners.append(_upright((edges[i], edges[i + 1]), (z, z + 0.55), -0.10))
        uvs.append([[left, low], [right, low], [right, high], [left, high]])
    site.add("shop_name", quads(np.array(corners), np.array(uvs)), pose)
    rim = box((x[0] + 0.1, -0.099, z), (x[1] - 0.1, 0.0, z + 0.55), sides="-x+x+z-z")
    site.add("frame_dark", rim, pose)


def _awning(x: Span, z: float, depth: float = 1.2, drop: float = 0.7) -> Mesh:
    (a, b), low = x, z - drop
    top = [[a, -depth, low], [b, -depth, low], [b, -0.1, z], [a, -0.1, z]]
    under = [top[3], top[2], top[1], top[0]]
    lip = [[a, -depth, low - 0.22], [b, -depth, low - 0.22], [b, -depth, low], [a, -depth, low]]
    return quads(np.array([top, under, lip], dtype=float))


def balcony(site: Site, pose: Pose, x: Span, z: float) -> None:
    """A slab with a railing of bars."""
    deep = 1.1
    site.add("stone", box((x[0], -deep, z - 0.16), (x[1], 0.0, z), sides="-x+x-y+z-z"), pose)
    left = np.arange(x[0] + 0.04, x[1] - 0.02, 0.14)
    front = np.stack([left, 0 * left - deep + 0.03, 0 * left + z], axis=-1)
    out = np.arange(-deep + 0.15, -0.05, 0.14)
    sides = [np.stack([0 * out + end, out, 0 * out + z], axis=-1) for end in (x[0], x[1] - 0.02)]
    bar = box((0, 0, 0), (0.02, 0.02, 0.95), sides="-x-y")
    bars = [repeat(bar, np.concatenate([front, *sides]))]
    rail = box((x[0], -deep + 0.01, z + 0.95), (x[1], -deep + 0.07, z + 1.0), sides="-x+x-y+y+z-z")
    for near in (x[0], x[1] - 0.02):
        bars.append(box((near, -deep + 0.05, z + 0.95), (near + 0.02, 0.0, z + 1.0)))
    site.add("steel_dark", merge([*bars, rail]), pose)


def _upright(x: Span, z: Span, y: float = 0.0) -> list[list[float]]:
    (a, b), (c, d) = x, z
    return [[a, y, c], [b, y, c], [b, y, d], [a, y, d]]
