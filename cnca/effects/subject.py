"""What a picture's errors depend on, as numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from cnca.scene.cameras import View
from cnca.scene.materials import Material
from cnca.scene.weather import Weather
from cnca.vehicle.model import Vehicle
from cnca.world.model import World

TYPICAL = 16
"""Rays per pixel to which the noise's constant belongs."""


@dataclass(frozen=True)
class Contents:
    """What stands in a scene, whatever the view and the weather."""

    vehicle: Vehicle
    """With all that stands around it in the vehicle's materials."""
    world: World | None = None
    """What stands around them in materials of its own."""
    wetness: float = 0.0
    """Of the ground, in [0, 1]."""


@dataclass(frozen=True)
class Subject:
    """One or more views of a scene in one weather."""

    weather: Weather
    ground: float
    """Mean linear albedo of the ground in [0, 1]."""
    paint: float
    """Mean linear albedo of the texture in [0, 1]."""
    fog_path: float
    """Metres inside the fog layer between the camera and the vehicle."""
    pixels_per_metre: float
    """At the vehicle: the share of pixels that edges cross and make noisy falls with it."""
    amounts: Mapping[str, float] = field(default_factory=dict)
    """Effect → how much of it the scene holds (:meth:`cnca.effects.effect.Effect.amount`)."""

    @classmethod
    def of_views(
        cls,
        views: Sequence[View],
        weather: Weather,
        *,
        ground: float,
        paint: float,
        amounts: Mapping[str, float],
    ) -> Subject:
        """Views relative to the vehicle, at whose foot the distances are measured."""
        return cls(
            weather,
            ground=ground,
            paint=paint,
            fog_path=max(_path_in_layer(view, weather) for view in views),
            pixels_per_metre=min(_pixels_per_metre(view) for view in views),
            amounts=amounts,
        )

    @property
    def has_fog(self) -> bool:
        """Whether the scene names a layer that has a height."""
        return self.weather.fog is not None and self.weather.fog.height > 0

    @property
    def has_sun(self) -> bool:
        """Whether the sun shines."""
        return self.weather.sun_scale > 0 and self.weather.sun_altitude > 0

    @property
    def opacity(self) -> float:
        """1 − T of the fog between camera and vehicle."""
        fog = self.weather.fog
        return -math.expm1(-fog.extinction * self.fog_path) if fog is not None else 0.0

    @property
    def sun_share(self) -> float:
        """Share of the direct sun in the light at the vehicle.

        Above the fog 0.7^(m^0.678) of the sun's light arrives through the air mass m, and a tenth
        of what arrives comes from the sky besides (Meinel & Meinel 1976).
        """
        if not self.has_sun:
            return 0.0
        sine = max(math.sin(math.radians(self.weather.sun_altitude)), 0.01)
        arriving = 0.7 ** (sine**-0.678)
        fog = self.weather.fog
        direct = math.exp(-fog.extinction * fog.height / sine) if fog is not None else 1.0
        sun = self.weather.sun_scale * arriving
        sky = 0.1 * self.weather.sky_scale * max(arriving, 0.05)
        return sun * direct / (sun + sky)

    def features(self) -> list[float]:
        """x: constant, log albedos, opacity of the view, share of the sun."""
        albedos = [math.log(self.ground + 0.02), math.log(self.paint + 0.02)]
        return [1.0, *albedos, self.opacity, self.sun_share]

    def noise_features(self, samples: int) -> list[float]:
        """x of the noise, whose last weight is minus the rate at which it falls with samples."""
        return [*self.features(), math.log(self.pixels_per_metre), math.log(samples / TYPICAL)]


def mean_over_area(vehicle: Vehicle, value: Callable[[Material], float]) -> float:
    """A property of the materials, such as their clear coat, averaged by area over all parts."""
    areas, values = [], []
    for part in vehicle.parts:
        a, b, c = np.moveaxis(part.vertices[part.faces], 1, 0)
        areas.append(np.linalg.norm(np.cross(b - a, c - a), axis=-1).sum() / 2)
        values.append(value(vehicle.material(part.material)))
    return float(np.dot(areas, values) / max(sum(areas), 1e-12))


def _pixels_per_metre(view: View) -> float:
    """At the distance of the vehicle's foot."""
    distance = max(float(np.linalg.norm(view.origin)), 1e-3)
    return view.width / (2 * np.tan(np.radians(view.fov) / 2) * distance)


def _path_in_layer(view: View, weather: Weather) -> float:
    """Metres of the way from the camera to the vehicle's foot that lie in fog."""
    if weather.fog is None:
        return 0.0
    height = view.origin[2]
    inside = min(weather.fog.height / height, 1.0) if height > 0 else 1.0
    return float(np.linalg.norm(view.origin)) * inside
