"""The Mitsuba backend: a :class:`cnca.protocols.Renderer`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Float

from cnca.errors import NonFiniteError, TextureError
from cnca.mi_bridge.bridge import Shot, render
from cnca.mi_bridge.fog import FogField, solve_fog
from cnca.mi_bridge.geometry import Geometry
from cnca.mi_bridge.integrator import FogLayer, Sky, Surroundings
from cnca.mi_bridge.layers import (
    Layers,
    first_hits,
    mask_boxes,
    refuse_inside,
    vehicle_mask,
)
from cnca.mi_bridge.light import lambertian_white, make_light
from cnca.mi_bridge.rays import Cameras
from cnca.scene.cameras import View
from cnca.scene.effects import explain
from cnca.scene.mesh import Part, Vehicle
from cnca.scene.weather import Weather
from cnca.types import Boxes, LinearImages, LinearTexture

WEATHERS_KEPT = 64
"""Weathers whose sky and fog stay in memory (about 3 MB each)."""

ROUNDING = 1e-4
"""By how much an albedo may leave [0, 1]; less than the floor that keeps it positive."""


@dataclass(frozen=True)
class _Atmosphere:
    surroundings: Surroundings
    exposure: float


class MitsubaRenderer:
    """Path-traced pictures of one vehicle, differentiable in its texture."""

    def __init__(
        self,
        vehicle: Vehicle,
        *,
        ground_albedo: Sequence[float] = (0.15, 0.15, 0.15),
        texture_size: int = 512,
        samples: int = 16,
        bounces: int = 2,
        exposure: float = 1.0,
        props: tuple[Part, ...] = (),
    ):
        """
        Args:
            ground_albedo: linear RGB in [0, 1].
            texture_size: texels per side of the textures that :meth:`render` takes.
            samples: rays per pixel.
            bounces: surface reflections of a path; 1 is sun and sky alone.
            exposure: factor on the metered exposure.
            props: other things that stand around; painted ones wear the vehicle's texture.
        """
        self.vehicle = vehicle
        self.ground_albedo = np.asarray(ground_albedo, dtype=np.float64)
        self.geometry = Geometry(vehicle, self.ground_albedo, texture_size, props)
        self.samples, self.bounces, self.exposure = samples, bounces, exposure
        self._atmosphere = lru_cache(maxsize=WEATHERS_KEPT)(self._make_atmosphere)

    def render(
        self, albedo: LinearTexture, views: Sequence[View], weather: Weather, *, seed: int
    ) -> LinearImages:
        """Exposed linear images (views, 3, height, width); see :class:`cnca.protocols.Renderer`.

        Raises:
            TextureError: the texture has another shape than (3, size, size), holds NaN, or leaves
                [0, 1].
            NonFiniteError: a view came out with NaN or infinity.
        """
        _refuse_bad_texture(albedo.detach(), self.geometry.texture_size)
        atmosphere = self._atmosphere(weather)
        shot = Shot(
            self.geometry,
            atmosphere.surroundings,
            Cameras(views),
            samples=self.samples,
            bounces=self.bounces,
            seed=seed,
            exposure=atmosphere.exposure * self.exposure,
        )
        images = render(albedo.permute(1, 2, 0), shot).permute(0, 3, 1, 2)
        _refuse_non_finite(images.detach(), views, weather, seed)
        return images

    def layers(self, views: Sequence[View]) -> Layers:
        """What each view's camera hits first; independent of texture and weather."""
        return first_hits(self.geometry, Cameras(views))

    def vehicle_mask(self, views: Sequence[View]) -> Float[np.ndarray, "views height width"]:
        """Share of each pixel that the vehicle covers, in [0, 1]."""
        return vehicle_mask(self.geometry, Cameras(views))

    def vehicle_boxes(self, views: Sequence[View]) -> Boxes:
        """Bounding boxes (views, 4) of all pixels that the vehicle touches, xyxy.

        Raises:
            SceneError: a view does not show the vehicle, or its camera is inside of it.
        """
        for view in views:
            refuse_inside(self.geometry, view)
        return mask_boxes(self.vehicle_mask(views), views)

    def plan(self, weather: Weather) -> list[dict[str, str]]:
        """Which model stands for each effect in this weather, and why."""
        surroundings = self._atmosphere(weather).surroundings
        return explain(weather, has_sun=surroundings.sky.has_sun, bounces=self.bounces)

    def _make_atmosphere(self, weather: Weather) -> _Atmosphere:
        light = make_light(weather, self.ground_albedo)
        sky = Sky(light)
        fog = weather.fog
        if fog is None or fog.height == 0:
            white = lambertian_white(light.sky, light.sun_irradiance, light.sun_direction)
            return _Atmosphere(Surroundings(sky, None), _exposure(white))
        field = solve_fog(fog, light, self.ground_albedo)
        white = lambertian_white(*_at_height(field, 1.0), light.sun_direction)
        return _Atmosphere(Surroundings(sky, FogLayer(fog, field, sky)), _exposure(white))


def _exposure(white: float) -> float:
    """Inverse of the metered white; in a night without any light the picture is simply black."""
    return 1.0 / white if white > 0 else 1.0


def _at_height(
    field: FogField, height: float
) -> tuple[Float[np.ndarray, "rows columns 3"], Float[np.ndarray, "3"]]:
    """Diffuse radiance and direct sun at a height in the layer."""
    level = int(np.searchsorted(field.heights, height).clip(0, len(field.heights) - 1))
    return field.radiance[level], field.sun[level]


def _refuse_bad_texture(albedo: torch.Tensor, size: int) -> None:
    if tuple(albedo.shape) != (3, size, size):
        raise TextureError(
            f"texture of shape {tuple(albedo.shape)}: the renderer takes (3, {size}, {size})"
        )
    low, high = (float(bound) for bound in torch.aminmax(albedo))  # NaN if any texel is
    if not (low >= -ROUNDING and high <= 1 + ROUNDING):
        raise TextureError(f"texture has values from {low:g} to {high:g}: albedo lies in [0, 1]")


def _refuse_non_finite(
    images: torch.Tensor, views: Sequence[View], weather: Weather, seed: int
) -> None:
    finite = torch.isfinite(images).flatten(1).all(dim=1)
    if not finite.all():
        view = views[int((~finite).nonzero()[0, 0])].name
        effect = "fog" if weather.fog else "clear air"
        raise NonFiniteError(f"render of view {view} in {effect} with seed {seed} is not finite")
