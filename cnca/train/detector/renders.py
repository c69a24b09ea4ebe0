"""Renders the pictures on which detectors are trained and tested.

Every picture shows a vehicle, or none, among boxes, barrels and the like that may wear the same
texture: so no blob on the ground makes a car.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import torch

from cnca.core.color import linear_to_srgb
from cnca.core.errors import DetectorError
from cnca.core.progress import bar
from cnca.core.types import SrgbTexture
from cnca.gen import textures
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.scene import controls
from cnca.scene.cameras import View, orbit_view
from cnca.scene.paint import Paint
from cnca.scene.weather import Fog, Weather
from cnca.train.detector.obstacles import CAR, obstacle_boxes
from cnca.train.detector.parts import Picture, join, save_part
from cnca.vehicle.builtin import props
from cnca.vehicle.builtin.sedan import BUILTIN_VEHICLES, build_sedan
from cnca.vehicle.model import Part, Vehicle

ORDINARY, LOUD = ("plain", "uniform"), ("blocks", "shuffled", "prompt")
GROUPS = (*ORDINARY, *LOUD)
"""Kinds of paint; a picture without a vehicle is in the group ``empty``."""
PICTURES_PER_SCENE = 15
WEATHERS_PER_SCENE = 3
FOG_SHARE = 0.4
TEXTURE_SIZE, SAMPLES = 256, 8
LEAST_PIXELS = 300
"""A vehicle of which fewer pixels are seen is no target."""
PLAIN_PAINTS = (
    (0.92, 0.92, 0.92), (0.78, 0.79, 0.80), (0.45, 0.46, 0.48), (0.06, 0.06, 0.07),
    (0.60, 0.05, 0.06), (0.08, 0.16, 0.45), (0.05, 0.25, 0.16), (0.78, 0.70, 0.55),
)  # fmt: skip
"""sRGB colors in which most cars are sold."""


@dataclass(frozen=True)
class Cast:
    """What the pictures show, apart from surroundings, weather and views."""

    vehicles: Mapping[str, Callable[[], Vehicle]]
    """Name → what builds it; a scene shows one of them, or none."""
    paint: Paint
    groups: tuple[str, ...] = GROUPS
    """Kinds of paint, in turn over all scenes."""
    textures: Mapping[str, SrgbTexture] = field(default_factory=dict)
    """Kinds of paint that are one texture each."""
    empty_share: float = 0.15
    """Share of the scenes without a vehicle."""
    empty_groups: tuple[str, ...] | None = None
    """Kinds of paint on the things in those scenes; None for the kinds of the vehicles."""

    def group(self, picture: int, *, empty: bool) -> str:
        """The kind of paint in a picture, counted over all scenes."""
        groups = (self.empty_groups if empty else None) or self.groups
        return groups[picture % len(groups)]


BUILTIN_CAST = Cast(
    {name: partial(build_sedan, shape, name) for name, shape in BUILTIN_VEHICLES.items()},
    Paint(
        SrgbTexture(torch.zeros(3, TEXTURE_SIZE, TEXTURE_SIZE)),
        torch.ones(1, TEXTURE_SIZE, TEXTURE_SIZE),
    ),
    ORDINARY,
    empty_share=0.3,
    empty_groups=LOUD,
)
"""All built-in vehicles.  What is loud is no vehicle, as on roads: loud paint is on the things
around, in scenes without a vehicle.  A detector that sees vehicles in loud paint learns to
disregard paint altogether, and no camouflage moves it."""


def render_detector_data(
    out: Path, *, pictures: int, seed: int, size: int = 256, cast: Cast = BUILTIN_CAST
) -> None:
    """Write ``images.npy`` and ``labels.json`` into ``out``; continues where it was interrupted.

    Args:
        pictures: how many; rounded up to whole scenes of 15.
        size: pixels per side.
        cast: vehicles and paints.

    Raises:
        DetectorError: ``pictures`` is not positive.
    """
    if pictures < 1:
        raise DetectorError(f"--pictures {pictures}: give at least one")
    out.mkdir(parents=True, exist_ok=True)
    scenes = -(-pictures // PICTURES_PER_SCENE)
    parts = [out / f"scene{index:04d}-{seed}.npz" for index in range(scenes)]
    with bar() as progress:
        for index, part in enumerate(progress.track(parts, description="scenes for the detector")):
            if not part.exists():
                save_part(
                    part, _render_scene(np.random.default_rng([seed, index]), index, size, cast)
                )
    join(out, parts)


def _render_scene(rng: np.random.Generator, scene: int, size: int, cast: Cast) -> list[Picture]:
    empty = rng.random() < cast.empty_share
    name = str(rng.choice(list(cast.vehicles)))
    vehicle = Vehicle("none", ()) if empty else cast.vehicles[name]()
    things = surround(rng)
    renderer = MitsubaRenderer(
        vehicle,
        ground_albedo=(rng.uniform(0.04, 0.4) * rng.uniform(0.85, 1.15, 3)).tolist(),
        texture_size=cast.paint.base.shape[-1],
        samples=SAMPLES,
        props=things,
    )
    weathers = [
        draw_weather(rng, lowest_sun=8, least_sight=40, fog_share=FOG_SHARE)
        for _ in range(WEATHERS_PER_SCENE)
    ]
    pictures = []
    for k in range(PICTURES_PER_SCENE):
        group = cast.group(scene * PICTURES_PER_SCENE + k, empty=empty)
        albedo = cast.paint.apply(draw_texture(group, rng, cast.textures))
        view = next(v for v in _views(rng, size) if empty or _shows(renderer, v))
        seed = int(rng.integers(2**31))
        with torch.no_grad():
            image = renderer.render(albedo, [view], weathers[k % len(weathers)], seed=seed)
        boxes = [] if empty else [[*renderer.vehicle_boxes([view])[0].tolist(), CAR]]
        boxes += obstacle_boxes(things, view, hidden_by=boxes)
        pixels = (linear_to_srgb(image)[0].permute(1, 2, 0) * 255).round().byte().numpy()
        pictures.append(Picture(pixels, boxes, "empty" if empty else group))
    return pictures


def surround(rng: np.random.Generator) -> tuple[Part, ...]:
    """Three to eight props in a ring around the vehicle, two thirds of them in its texture."""
    ring = []
    for _ in range(rng.integers(3, 9)):
        angle, distance = rng.uniform(0, 2 * np.pi), rng.uniform(4.2, 13)
        material = "paint" if rng.random() < 0.67 else str(rng.choice(["trim", "metal", "plate"]))
        place = (distance * np.cos(angle), distance * np.sin(angle))
        ring.append(props.placed(props.draw_prop(rng), material, place, rng.uniform(0, 2 * np.pi)))
    # At least one painted thing, so that pictures without a vehicle still show the texture.
    ring.append(props.placed(props.draw_prop(rng), "paint", (0.0, 5.5), rng.uniform(0, np.pi)))
    return tuple(ring)


def draw_weather(
    rng: np.random.Generator, *, lowest_sun: float, least_sight: float, fog_share: float
) -> Weather:
    """Sun from ``lowest_sun`` to 75°, sometimes overcast; fog of ``least_sight`` to 600 m."""
    foggy = rng.random() < fog_share
    fog = Fog(float(np.exp(rng.uniform(np.log(least_sight), np.log(600))))) if foggy else None
    return Weather(
        sun_altitude=float(rng.uniform(lowest_sun, 75)),
        sun_azimuth=float(rng.uniform(0, 360)),
        turbidity=float(rng.uniform(2, 6)),
        sun_scale=float(rng.choice([1.0, 1.0, 0.05])),
        fog=fog,
    )


def _shows(renderer: MitsubaRenderer, view: View) -> bool:
    """Whether enough of the vehicle is seen past the props to call it one."""
    return bool((renderer.vehicle_mask([view]) > 0.5).sum() >= LEAST_PIXELS)


def _views(rng: np.random.Generator, size: int) -> Iterator[View]:
    """Endless random views."""
    while True:
        yield _view(rng, size)


def _view(rng: np.random.Generator, size: int) -> View:
    distance = float(rng.uniform(5.5, 14))
    aim = rng.uniform(-0.12, 0.12, 3) * distance
    return orbit_view(
        float(rng.uniform(0, 360)),
        float(rng.uniform(2, 40)),
        distance,
        fov=45.0,
        width=size,
        height=size,
        target=(float(aim[0]), float(aim[1]), 0.7 + abs(float(aim[2])) / 2),
    )


def draw_texture(
    group: str, rng: np.random.Generator, fixed: Mapping[str, SrgbTexture]
) -> SrgbTexture:
    """A texture of a kind of paint; ``fixed`` are kinds that are one texture each."""
    generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
    if group in fixed:
        return fixed[group]
    if group == "plain":
        color = torch.tensor(PLAIN_PAINTS[rng.integers(len(PLAIN_PAINTS))])
        return SrgbTexture(color[:, None, None].expand(3, TEXTURE_SIZE, TEXTURE_SIZE).clone())
    if group == "uniform":
        return controls.uniform(TEXTURE_SIZE, generator)
    if group == "blocks":
        return controls.random_blocks(TEXTURE_SIZE, generator, blocks=int(rng.integers(4, 24)))
    texture = torch.from_numpy(textures.sample(rng).picture).permute(2, 0, 1).float()
    if group == "shuffled":
        return controls.shuffled(
            SrgbTexture(texture), generator, blocks=int(2 ** rng.integers(2, 6))
        )
    return SrgbTexture(texture)
