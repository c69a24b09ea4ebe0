"""Renders streets full of traffic with the boxes of all vehicles, to train detectors on.

A scene is one place in one built-in world, in two weathers: a vehicle in ordinary paint stands
there, and the world's traffic around it.  A quarter of the cameras look along the road from a
driver's height; the others circle the vehicle.  In some scenes boxes and barrels stand there
instead, in loud paint.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import torch

from cnca.core.color import linear_to_srgb
from cnca.core.progress import bar
from cnca.core.types import LinearTexture
from cnca.effects.plan import Demand
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.scene.cameras import View, orbit_view
from cnca.scene.layers import Sighting
from cnca.train.detector.obstacles import CAR, obstacle_boxes
from cnca.train.detector.parts import Picture, join, save_part
from cnca.train.detector.renders import (
    BUILTIN_CAST,
    LOUD,
    ORDINARY,
    TEXTURE_SIZE,
    draw_texture,
    draw_weather,
    surround,
)
from cnca.vehicle.model import Vehicle
from cnca.world.builtin import BUILTIN_WORLDS, build

SIZE = (256, 416)
"""Height and width of the pictures in pixels."""
SAMPLES = 8
VIEWS, WEATHERS = 8, 2
"""Per scene; every view is taken in every weather."""
EMPTY_SHARE, FOG_SHARE = 0.25, 0.25
"""Shares of the scenes with loud things in place of the vehicle, and of the weathers with fog."""
LEAST_WIDTH, LEAST_SEEN = 9, 0.3
"""Pixels across and visible share from which on a vehicle is a target."""
VEHICLES = ("car", "truck", "bus")
"""Traffic that counts as class ``car``."""


def render_streets(out: Path, *, pictures: int, seed: int) -> None:
    """Write ``images.npy`` and ``labels.json`` into ``out``; continues where it was interrupted.

    ``pictures`` is rounded up to whole scenes of ``VIEWS · WEATHERS``; groups are the worlds.
    """
    out.mkdir(parents=True, exist_ok=True)
    scenes = -(-pictures // (VIEWS * WEATHERS))
    parts = [out / f"street{index:04d}-{seed}.npz" for index in range(scenes)]
    with bar() as progress:
        for index, part in enumerate(progress.track(parts, description="streets")):
            if not part.exists():
                save_part(part, list(_scene(np.random.default_rng([seed, index]), index)))
    join(out, parts)


def _scene(rng: np.random.Generator, index: int) -> Iterator[Picture]:
    kind = list(BUILTIN_WORLDS)[index % len(BUILTIN_WORLDS)]
    world = build(kind, int(rng.integers(2**31)))
    world = world.around(world.places[rng.integers(len(world.places))])
    empty = rng.random() < EMPTY_SHARE
    name, things = str(rng.choice(list(BUILTIN_CAST.vehicles))), surround(rng) if empty else ()
    renderer = MitsubaRenderer(
        Vehicle("things", things) if empty else BUILTIN_CAST.vehicles[name](),
        texture_size=TEXTURE_SIZE,
        samples=SAMPLES,
        exposure=float(np.exp(rng.uniform(np.log(0.45), np.log(1.1)))),
        demand=Demand(forced={"gradient": "off", "surroundings": "geometry"}),
        worlds=lambda _: world,
    )
    views = [_orbit(rng) if k % 4 else driver(rng) for k in range(VIEWS)]
    boxes = [
        _boxes(renderer, view, ours=not empty) + obstacle_boxes(things, view) for view in views
    ]
    for _ in range(WEATHERS):
        weather = draw_weather(rng, lowest_sun=6, least_sight=50, fog_share=FOG_SHARE)
        for view, vehicles in zip(views, boxes, strict=True):
            seed, albedo = int(rng.integers(2**31)), _paint(rng, LOUD if empty else ORDINARY)
            with torch.no_grad():
                image = renderer.render(albedo, [view], weather, seed=seed)
            pixels = (linear_to_srgb(image)[0].permute(1, 2, 0) * 255).round().byte().numpy()
            yield Picture(pixels, vehicles, kind)


def _paint(rng: np.random.Generator, groups: Sequence[str]) -> LinearTexture:
    return BUILTIN_CAST.paint.apply(draw_texture(str(rng.choice(groups)), rng, {}))


def _boxes(renderer: MitsubaRenderer, view: View, *, ours: bool) -> list[list[float]]:
    """xyxy and class of every vehicle, ours and the traffic's, that is wide and free enough."""
    [share], [mask] = renderer.visible_shares([view]), renderer.vehicle_mask([view]) > 0.5
    seen = [Sighting("car", mask, 1 - share)] if ours and mask.any() else []
    seen += [other for other in renderer.sightings([view])[0] if other.label in VEHICLES]
    return [
        [*map(float, vehicle.box), CAR]
        for vehicle in seen
        if vehicle.box[2] - vehicle.box[0] >= LEAST_WIDTH and 1 - vehicle.occluded >= LEAST_SEEN
    ]


def driver(rng: np.random.Generator) -> View:
    """From a driver's or a lorry's height, on the road before or behind the vehicle."""
    height, width = SIZE
    ahead = rng.random() < 0.5
    x = rng.uniform(2.6, 4.0) if ahead else rng.uniform(-45, -6)
    aim = rng.normal(0, 0.12 if ahead else 0.06)
    direction = np.pi + aim if rng.random() < 0.25 and ahead else aim
    z = rng.uniform(1.3, 2.6)
    target = (x + 10 * np.cos(direction), 10 * np.sin(direction), z + rng.uniform(-1.2, 0.5))
    y = 0.0 if ahead else rng.uniform(-1.5, 1.5)
    return View(
        "driver",
        (float(x), float(y), float(z)),
        (float(target[0]), float(target[1] + y), float(target[2])),
        (0.0, 0.0, 1.0),
        float(rng.uniform(60, 100)),
        width,
        height,
    )


def _orbit(rng: np.random.Generator) -> View:
    height, width = SIZE
    distance = float(np.exp(rng.uniform(np.log(5), np.log(18))))
    aim = rng.uniform(-0.25, 0.25, 3) * distance
    return orbit_view(
        float(rng.uniform(0, 360)),
        float(rng.uniform(2, 28)),
        distance,
        fov=float(rng.uniform(40, 80)),
        width=width,
        height=height,
        target=(float(aim[0]), float(aim[1]), 0.7 + abs(float(aim[2])) / 3),
    )
