"""Houses in a row: façades of many styles, roofs, gables, doors."""

from __future__ import annotations

import numpy as np

from cnca.world.builtin.facades import Style, balcony, bays, reveal, shop_front, wall, windows
from cnca.world.builtin.finishes import DOORS, PLASTERS
from cnca.world.builtin.meshes import box, merge, quads, tube
from cnca.world.builtin.site import Pose, Site

Span = tuple[float, float]
DEPTH = 11.0
"""From the façade to the back of a house, metres."""


def draw_style(rng: np.random.Generator) -> Style:
    """The style of one house."""
    kind = rng.choice(["plaster", "brick", "stone", "modern"], p=[0.42, 0.28, 0.12, 0.18])
    walls = {
        "plaster": PLASTERS,
        "brick": ("brick", "brick_brown", "brick_yellow"),
        "stone": ("ashlar", "ashlar_grey"),
        "modern": ("concrete", "plaster_4", "plaster_3", "brick_brown"),
    }[str(kind)]
    surface = str(rng.choice(walls))
    modern = kind == "modern"
    base = (
        surface if rng.random() < 0.35 else str(rng.choice(["ashlar", "ashlar_grey", "concrete"]))
    )
    frames = ["frame_dark"] if modern else ["frame_white", "frame_white", "frame_brown"]
    window = (
        (rng.uniform(1.5, 2.2), 1.6) if modern else (rng.uniform(1.0, 1.3), rng.uniform(1.5, 1.8))
    )
    return Style(
        wall=surface,
        base=base,
        frame=str(rng.choice(frames)),
        trim="zinc" if modern else "stone",
        window=(float(window[0]), float(window[1])),
        bay=float(window[0] + rng.uniform(0.9, 1.5)),
        storey=float(rng.uniform(2.9, 3.3)),
        ground_floor=float(rng.uniform(3.5, 4.1)),
        storeys=int(rng.integers(2, 6)),
        balconies=bool(rng.random() < (0.6 if modern else 0.22)),
        lintels=bool(not modern and rng.random() < 0.6),
    )


def house(
    site: Site,
    rng: np.random.Generator,
    pose: Pose,
    style: Style,
    width: float,
    *,
    shop: bool,
    corners: tuple[bool, bool] = (False, False),
) -> float | None:
    """A house whose façade runs from (0, 0) to (width, 0) of the pose, and whose back is +y.

    ``corners`` tells whether the left and the right side wall stand free.  Returns x of the door
    of a house without a shop.
    """
    entrance = None
    if shop:
        shop_front(site, rng, pose, style, (0.35, width - 0.35), style.ground_floor)
        ends = [
            quads(np.array([[[a, 0, 0], [a + 0.35, 0, 0], [a + 0.35, 0, h], [a, 0, h]]]))
            for a, h in ((0.0, style.ground_floor), (width - 0.35, style.ground_floor))
        ]
        site.add(style.base, merge(ends), pose)
    else:
        plinth = box((0, -0.05, -0.2), (width, 0.0, 0.5), sides="-x+x-y+z")
        site.add("concrete" if style.base.startswith("brick") else "ashlar_grey", plinth, pose)
        entrance = _ground_floor(site, rng, pose, style, width)
    _upper_floors(site, rng, pose, style, width)
    top = style.ground_floor + style.storeys * style.storey
    _flanks(site, rng, pose, style, width, top, corners)
    band = [
        box(
            (0, -0.08, style.ground_floor - 0.12),
            (width, 0.0, style.ground_floor + 0.08),
            sides="-x+x-y+z-z",
        )
    ]
    band.append(box((0, -0.35, top - 0.1), (width, 0.0, top + 0.22), sides="-x+x-y+z-z"))
    if style.lintels:
        band.append(box((0, -0.18, top - 0.4), (width, 0.0, top - 0.1), sides="-x+x-y+z-z"))
    site.add(style.trim, merge(band), pose)
    pipe = np.array([[width - 0.15, -0.09, 0.0], [width - 0.15, -0.09, top]])
    site.add("zinc", tube(pipe, np.array([0.05, 0.05]), 8), pose)
    _roof(site, rng, pose, style, width, top)
    return entrance


def _ground_floor(
    site: Site, rng: np.random.Generator, pose: Pose, style: Style, width: float
) -> float:
    middles = bays(style, width)
    entrance = int(rng.integers(len(middles)))
    top = min(style.ground_floor - 0.7, 2.9)
    left = np.delete(middles, entrance) - style.window[0] / 2
    feet = np.stack([left, 0 * left + 1.2], axis=-1)
    windows(site, rng, pose, style, feet, (style.window[0], top - 1.2))
    holes = [((float(a), float(a + style.window[0])), (1.2, top)) for a in left]
    span = (float(middles[entrance] - 0.6), float(middles[entrance] + 0.6))
    holes.append((span, (0.0, 2.45)))
    _door(site, rng, pose, style, span)
    site.add(style.base, wall((0.0, width), (0.0, style.ground_floor), holes), pose)
    return float(middles[entrance])


def _door(
    site: Site, rng: np.random.Generator, pose: Pose, style: Style, x: tuple[float, float]
) -> None:
    """A panelled door with a light above it, a step and a small roof."""
    a, b = x
    site.add(style.base, reveal(x, (0.0, 2.45), 0.2), pose)
    surface = str(rng.choice(DOORS))
    leaf = [box((a, 0.17, 0.0), (b, 0.2, 2.0), sides="-y")]
    for left, right in ((a + 0.12, (a + b) / 2 - 0.06), ((a + b) / 2 + 0.06, b - 0.12)):
        for low, high in ((0.15, 0.85), (1.0, 1.85)):
            leaf.append(box((left, 0.145, low), (right, 0.17, high), sides="-x+x-y+z-z"))
    site.add(surface, merge(leaf), pose)
    light = np.array([[[a, 0.19, 2.05], [b, 0.19, 2.05], [b, 0.19, 2.45], [a, 0.19, 2.45]]])
    site.add("pane", quads(light, np.array([[[0, 0], [0.1, 0], [0.1, 0.1], [0, 0.1]]])), pose)
    site.add(style.frame, box((a, 0.12, 2.0), (b, 0.2, 2.07), sides="-y+z-z"), pose)
    site.add("stone", box((a - 0.2, -0.5, 0.0), (b + 0.2, 0.05, 0.14), sides="-x+x-y+z"), pose)
    site.add("zinc", box((a - 0.35, -0.8, 2.62), (b + 0.35, 0.0, 2.70), sides="-x+x-y+z-z"), pose)
    knob = box((b - 0.2, 0.09, 1.0), (b - 0.16, 0.145, 1.12), sides="-x+x-y+z-z")
    site.add("steel", knob, pose)


def _upper_floors(
    site: Site, rng: np.random.Generator, pose: Pose, style: Style, width: float
) -> None:
    left = bays(style, width) - style.window[0] / 2
    with_balcony = rng.random(len(left)) < (0.4 if style.balconies else 0.0)
    floors = style.ground_floor + style.storey * np.arange(style.storeys)
    high = min(style.window[1], style.storey - 1.2)
    holes: list[tuple[Span, Span]] = []
    for chosen, low, rise in ((~with_balcony, 0.9, high), (with_balcony, 0.05, high + 0.85)):
        x, z = np.meshgrid(left[chosen], floors + low)
        feet = np.stack([x.ravel(), z.ravel()], axis=-1)
        windows(site, rng, pose, style, feet, (style.window[0], rise))
        holes += [((a, a + style.window[0]), (c, c + rise)) for a, c in feet.tolist()]
    reach = style.bay / 2 - 0.12
    for middle in left[with_balcony] + style.window[0] / 2:
        for floor in floors:
            balcony(site, pose, (float(middle - reach), float(middle + reach)), float(floor))
    top = style.ground_floor + style.storeys * style.storey
    site.add(style.wall, wall((0.0, width), (style.ground_floor, top), holes), pose)


def _flanks(
    site: Site,
    rng: np.random.Generator,
    pose: Pose,
    style: Style,
    width: float,
    top: float,
    corners: tuple[bool, bool],
) -> None:
    """Side walls and back; those that stand free have windows."""
    walls = [
        (0.0, DEPTH, -90.0, DEPTH, corners[0]),
        (width, 0.0, 90.0, DEPTH, corners[1]),
        (width, DEPTH, 180.0, width, False),
    ]
    for x, y, turn, span, is_free in walls:
        face = pose.then(x, y, turn)
        floors = style.ground_floor + style.storey * np.arange(style.storeys if is_free else 0)
        left, low = np.meshgrid(np.array([0.2, 0.5, 0.8]) * span - 0.5, floors + 0.9)
        feet = np.stack([left.ravel(), low.ravel()], axis=-1)
        windows(site, rng, face, style, feet, (1.0, 1.4))
        holes = [((a, a + 1.0), (c, c + 1.4)) for a, c in feet.tolist()]
        site.add(style.wall, wall((0.0, span), (-0.2, top), holes), face)


def _roof(
    site: Site, rng: np.random.Generator, pose: Pose, style: Style, width: float, top: float
) -> None:
    if style.trim == "zinc" or rng.random() < 0.2:
        parapet = [
            box((0, -0.05, top), (width, 0.25, top + 0.7)),
            box((0, 0.0, top), (0.25, DEPTH, top + 0.7)),
            box((width - 0.25, 0.0, top), (width, DEPTH, top + 0.7)),
        ]
        site.add(style.wall, merge(parapet), pose)
        site.add("roof_felt", box((0, 0, top), (width, DEPTH, top + 0.3), sides="+z"), pose)
        return
    rise, eaves, middle = DEPTH / 2 * 0.8, 0.45, DEPTH / 2
    low = top + 0.2 - 0.8 * eaves
    front = [
        [0, -eaves, low],
        [width, -eaves, low],
        [width, middle, top + rise],
        [0, middle, top + rise],
    ]
    back = [
        [width, DEPTH + eaves, low],
        [0, DEPTH + eaves, low],
        [0, middle, top + rise],
        [width, middle, top + rise],
    ]
    surface = str(rng.choice(["roof_tiles", "roof_slate"], p=[0.6, 0.4]))
    site.add(surface, quads(np.array([front, back], dtype=float)), pose)
    gables = [
        [[0, DEPTH, top], [0, 0, top], [0, middle, top + rise], [0, middle, top + rise]],
        [
            [width, 0, top],
            [width, DEPTH, top],
            [width, middle, top + rise],
            [width, middle, top + rise],
        ],
    ]
    site.add(style.wall, quads(np.array(gables, dtype=float)), pose)
    gutter = np.array([[0.0, -eaves, low], [width, -eaves, low]])
    site.add("zinc", tube(gutter, np.array([0.07, 0.07]), 8), pose)
    for x in rng.uniform(1.5, max(1.6, width - 1.5), int(rng.integers(1, 3))):
        chimney = box(
            (x - 0.4, middle - 0.9, top + rise - 1.0), (x + 0.4, middle - 0.2, top + rise + 0.9)
        )
        site.add("brick", chimney, pose)
    if rng.random() < 0.6:
        _dormers(site, rng, pose, style, width, top)


def _dormers(
    site: Site, rng: np.random.Generator, pose: Pose, style: Style, width: float, top: float
) -> None:
    """Small gabled boxes in the front slope above every second bay."""
    for middle in bays(style, width)[::2]:
        a, b, z = float(middle - 0.8), float(middle + 0.8), top + 0.7
        face = pose.then(0.0, 0.55)
        opening = ((a + 0.25, b - 0.25), (z + 0.35, z + 1.45))
        site.add(style.wall, wall((a, b), (z, z + 1.7), [opening]), face)
        windows(site, rng, face, style, np.array([[a + 0.25, z + 0.35]]), (1.1, 1.1))
        site.add(style.wall, box((a, 0.0, z), (b, 3.0, z + 1.7), sides="-x+x"), face)
        lid = box((a - 0.15, -0.2, z + 1.7), (b + 0.15, 3.2, z + 1.85), sides="-x+x-y+z-z")
        site.add("zinc", lid, face)
