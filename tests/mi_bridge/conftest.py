"""A painted box on flat ground, the smallest thing that the renderer draws."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from cnca.mi_bridge.backgrounds import KeptBackgrounds
from cnca.mi_bridge.light import SKY_COLUMNS, SKY_ROWS, Light
from cnca.mi_bridge.lookups import LookupRenderer
from cnca.mi_bridge.raster import PlainShading
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.mi_bridge.shading_cache import TracedShading
from cnca.scene.cameras import View, orbit_view
from cnca.scene.protocols import Renderer
from cnca.vehicle.builtin.props import box
from cnca.vehicle.model import Vehicle

BOX = np.array([4.0, 2.0, 1.5])
"""Length, width and height in metres."""


@pytest.fixture(scope="session")
def vehicle() -> Vehicle:
    return Vehicle("box", (box(BOX),))


@pytest.fixture(scope="session")
def renderer(vehicle) -> MitsubaRenderer:
    return MitsubaRenderer(vehicle, texture_size=8, samples=64)


@pytest.fixture(scope="session", params=["mitsuba", "raster", "cached"])
def backend(request, renderer) -> Renderer:
    """Every renderer that keeps the contract."""
    kept = KeptBackgrounds(renderer, torch.full((3, 8, 8), 0.4))
    if request.param == "raster":
        return LookupRenderer(kept, PlainShading(kept))
    if request.param == "cached":
        return LookupRenderer(kept, TracedShading(kept, samples=64))
    return renderer


def orbit(azimuth: float = 35.0, elevation: float = 15.0, distance: float = 7.0, **more) -> View:
    return orbit_view(
        azimuth, elevation, distance, **({"fov": 45, "width": 16, "height": 16} | more)
    )


def uniform_light(radiance: float = 1.0) -> Light:
    """The same light from everywhere, without a sun."""
    sky = np.full((SKY_ROWS, SKY_COLUMNS, 3), radiance)
    return Light(np.array([0.6, 0.0, 0.8]), np.zeros(3), sky)
