"""Views and weather drawn from a scene's ranges: evenly spread, and known by their index alone."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from scipy.stats import qmc

from cnca.scene.cameras import Spot, View, orbit_view
from cnca.scene.schema import Scene
from cnca.scene.weather import Fog, Weather

Drawn = TypeVar("Drawn")
WORLD_DRAWS = 0x57D5
"""Keeps what is drawn of worlds apart from other draws of the same seed."""


def draw_views(
    scene: Scene, count: int, *, seed: int, start: int = 0, spot: Spot | None = None
) -> list[View]:
    """Views number ``start`` to ``start + count`` of the scene's endless, seeded sequence.

    The sequence is a scrambled Sobol sequence over azimuth, elevation and distance; ``spot`` is
    where in the scene's world all of them are taken.  What the world hides plays no part here: see
    :func:`cnca.world.draw.draw_blocks`.
    """
    ranges = scene.variation
    spans = [ranges.azimuth, ranges.elevation, ranges.distance]
    return [
        orbit_view(
            azimuth,
            elevation,
            distance,
            fov=ranges.fov,
            width=scene.image.width,
            height=scene.image.height,
            spot=spot,
        )
        for azimuth, elevation, distance in _draw(spans, count, seed, start)
    ]


def draw_weathers(scene: Scene, count: int, *, seed: int) -> list[Weather]:
    """The first ``count`` weathers of the scene's seeded sequence.

    Visibility is spread evenly in extinction, since that is what dims a picture.
    """
    ranges, scene_weather = scene.variation, scene.weather()
    spans = [ranges.sun_altitude, ranges.sun_azimuth]
    if ranges.visibility is not None:
        low, high = ranges.visibility
        spans.append((1 / high, 1 / low))
    weathers = []
    for altitude, azimuth, *inverse in _draw(spans, count, seed, 0):
        fog = scene_weather.fog
        if inverse:
            fog = dataclasses.replace(fog or Fog(visibility=1.0), visibility=1 / inverse[0])
        weathers.append(dataclasses.replace(scene_weather.turned(altitude, azimuth), fog=fog))
    return weathers


def draw_spots(scene: Scene, *, seed: int) -> list[Spot]:
    """Places in worlds that a run goes to, those of one world together; evenly spread over it.

    Only the scene's own where it has no world, or draws none.
    """
    ranges = scene.variation
    if scene.world is None or ranges.places == 0:
        return [Spot()]
    rng = np.random.default_rng([seed, WORLD_DRAWS])
    builtin = scene.world.file.startswith("builtin:")
    seeds = rng.integers(1, 2**31 - 1, size=ranges.worlds).tolist() if builtin else [0]
    shares = (np.arange(ranges.places) + rng.random((len(seeds), ranges.places))) / ranges.places
    return [Spot(s, share) for s, row in zip(seeds, shares.tolist(), strict=True) for share in row]


def in_blocks(drawn: Sequence[Drawn], count: int) -> list[Sequence[Drawn]]:
    """Divide what was drawn into ``count`` blocks of neighbors, each spread as evenly as can be.

    Taking every n-th instead would give points that share their leading binary digits: with
    16 blocks, views from a sixteenth of the circle each.
    """
    ends = [len(drawn) * k // count for k in range(count + 1)]
    return [drawn[low:high] for low, high in itertools.pairwise(ends)]


def _draw(spans: list[tuple[float, float]], count: int, seed: int, start: int) -> list[list[float]]:
    sequence = qmc.Sobol(len(spans), scramble=True, rng=np.random.default_rng(seed))
    if start:
        sequence.fast_forward(start)
    # A Sobol sequence wants powers of two at once; one at a time it is the same sequence.
    points = np.array([sequence.random(1)[0] for _ in range(count)]).reshape(count, len(spans))
    low, high = np.array(spans).T
    return (low + points * (high - low)).tolist()
