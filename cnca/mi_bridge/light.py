"""Sun and sky as arrays, baked once per weather from Mitsuba's ``sunsky``.

Its model is that of Hosek & Wilkie (2012, 2013).

The integrator reads the sky from a latitude–longitude map and the sun as one direction with one
irradiance.  This keeps a change of weather an exchange of numbers: no emitter, no new kernel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Float

from cnca.mi_bridge.envmap import TurnedMap
from cnca.mi_bridge.night import starlight, twilight
from cnca.mi_bridge.variant import dr, mi
from cnca.scene.environment import read_environment, sky_directions, sky_solid_angles
from cnca.scene.weather import SkyMap, Weather

SKY_ROWS, SKY_COLUMNS = 128, 256
SUN_HALF_ANGLE = math.radians(0.5358 / 2)
"""Half of the sun's apparent diameter, the default of Mitsuba's ``sunsky``."""


@dataclass(frozen=True)
class Light:
    """What reaches the top of the fog layer, in W/m²/nm (irradiance) and W/m²/nm/sr (radiance)."""

    sun_direction: Float[np.ndarray, "3"]
    """Unit vector towards the sun."""
    sun_irradiance: Float[np.ndarray, "3"]
    """Linear RGB on a surface that faces the sun; zero when the sun is below the horizon."""
    sky: Float[np.ndarray, "rows columns 3"]
    """Linear RGB; row 0 looks up, column 0 looks along +x, columns run counter-clockwise."""
    map: TurnedMap | None = None
    """The measured environment of which ``sky`` is a coarse copy."""

    def scaled(self, factor: float) -> Light:
        """The same light, ``factor`` times as bright."""
        turned = self.map and replace(self.map, gain=factor * self.map.gain)
        return Light(self.sun_direction, factor * self.sun_irradiance, factor * self.sky, turned)

    @property
    def ground_albedo(self) -> Float[np.ndarray, "3"]:
        """Mean albedo in [0, 1] of ground that looks like the lower half of the sky's map."""
        rows, columns = self.sky.shape[:2]
        up = sky_directions(rows, columns)[..., 2:] * sky_solid_angles(rows, columns)[..., None]
        down = (self.sky * (-up).clip(min=0)).sum(axis=(0, 1))
        irradiance = (self.sky * up.clip(min=0)).sum(axis=(0, 1))
        irradiance = irradiance + self.sun_irradiance * max(self.sun_direction[2], 0.0)
        return (down / np.where(irradiance > 0, irradiance, 1.0)).clip(0, 1)


def make_light(weather: Weather, ground_albedo: Float[np.ndarray, "3"]) -> Light:
    """Evaluate sun and sky; directions below the horizon look at a lit, endless ground.

    Raises:
        SceneError, TextureError: the sky's map is missing or cannot be read.
    """
    if weather.sky_map is not None:
        return _measured_light(weather, weather.sky_map)
    altitude, azimuth = math.radians(weather.sun_altitude), math.radians(weather.sun_azimuth)
    direction = np.array(
        [
            math.cos(altitude) * math.cos(azimuth),
            math.cos(altitude) * math.sin(azimuth),
            math.sin(altitude),
        ]
    )
    directions = sky_directions(SKY_ROWS, SKY_COLUMNS)
    above = directions[: SKY_ROWS // 2]
    # The model ends at the horizon: a sun below it leaves the horizon's sky, darkened as twilight.
    lifted = max(altitude, math.radians(0.1))
    model_sun = np.array(
        [
            math.cos(lifted) * math.cos(azimuth),
            math.cos(lifted) * math.sin(azimuth),
            math.sin(lifted),
        ]
    )
    sky = np.zeros((SKY_ROWS, SKY_COLUMNS, 3))
    if weather.sky_scale > 0:
        radiance = _evaluate(model_sun, weather.turbidity, above, sun_scale=0.0)
        radiance = twilight(weather.sun_altitude) * radiance + starlight(weather.sun_altitude)
        sky[: SKY_ROWS // 2] = weather.sky_scale * radiance
    sun = np.zeros(3)
    if weather.sun_scale > 0 and altitude > 0:
        disc = _disc(model_sun)
        solid_angle = 2 * math.pi * (1 - math.cos(SUN_HALF_ANGLE))
        radiance = _evaluate(model_sun, weather.turbidity, disc, sky_scale=0.0)
        sun = weather.sun_scale * solid_angle * radiance.mean(axis=0)
    weights = sky_solid_angles(SKY_ROWS, SKY_COLUMNS)[..., None] * directions[..., 2:].clip(min=0)
    irradiance = (sky * weights).sum(axis=(0, 1)) + sun * max(direction[2], 0.0)
    sky[SKY_ROWS // 2 :] = ground_albedo * irradiance / np.pi
    return Light(direction, sun, sky)


def _measured_light(weather: Weather, sky_map: SkyMap) -> Light:
    """The light of a map, whose sun the weather knows already."""
    environment = read_environment(sky_map)
    altitude, azimuth = math.radians(weather.sun_altitude), math.radians(weather.sun_azimuth)
    flat = math.cos(altitude)
    direction = np.array([flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(altitude)])
    coarse = _coarse(environment.radiance, sky_map.rotation)
    return Light(
        direction,
        weather.sun_scale * environment.sun_irradiance,
        weather.sky_scale * coarse,
        TurnedMap(environment, weather.sky_scale, sky_map),
    )


def _coarse(
    radiance: Float[np.ndarray, "rows columns 3"], rotation: float
) -> Float[np.ndarray, "coarse_rows coarse_columns 3"]:
    """A map turned by that many degrees, its texels averaged."""
    rows, columns = radiance.shape[:2]
    if rows > SKY_ROWS:
        size = (SKY_COLUMNS, SKY_ROWS)
        coarse = cv2.resize(radiance, size, interpolation=cv2.INTER_AREA)
    else:
        row = ((np.arange(SKY_ROWS) + 0.5) * rows / SKY_ROWS).astype(int)
        column = ((np.arange(SKY_COLUMNS) + 0.5) * columns / SKY_COLUMNS).astype(int)
        coarse = radiance[np.ix_(row, column)]
    whole, part = divmod(rotation / 360 * SKY_COLUMNS, 1)
    turned = np.roll(coarse.astype(np.float64), int(whole), axis=1)
    return (1 - part) * turned + part * np.roll(turned, 1, axis=1)


def lambertian_white(
    light_from: Float[np.ndarray, "rows columns 3"],
    sun_irradiance: Float[np.ndarray, "3"],
    sun_direction: Float[np.ndarray, "3"],
) -> float:
    """Mean radiance of white matt card in this light: one lying flat, one upright facing the sun.

    Its inverse is the scene's exposure, as an incident-light meter would set it: an albedo of a
    becomes about a in the exposed image, whatever stands in front of the camera.
    """
    rows, columns = light_from.shape[:2]
    directions = sky_directions(rows, columns)
    weights = sky_solid_angles(rows, columns)
    facing = sun_direction * [1.0, 1.0, 0.0]
    length = np.linalg.norm(facing)
    # A sun in the zenith faces every upright card alike: take the one that looks along +x.
    facing = facing / length if length > 1e-6 else np.array([1.0, 0.0, 0.0])
    radiance = 0.0
    for normal in (np.array([0.0, 0.0, 1.0]), facing):
        cosine = (directions @ normal).clip(min=0.0) * weights
        irradiance = (light_from * cosine[..., None]).sum(axis=(0, 1))
        irradiance = irradiance + sun_irradiance * max(float(normal @ sun_direction), 0.0)
        radiance += float(irradiance.mean()) / math.pi / 2
    return radiance


def _disc(centre: Float[np.ndarray, "3"], rings: int = 64) -> Float[np.ndarray, "rings 3"]:
    """Directions spread evenly over the sun's disc (a Fibonacci spiral)."""
    k = np.arange(rings) + 0.5
    cosine = 1 - k / rings * (1 - math.cos(SUN_HALF_ANGLE))
    sine, angle = np.sqrt(1 - cosine**2), k * np.pi * (3 - math.sqrt(5))
    axis = mi.Normal3f(*centre.tolist())
    dr.make_opaque(axis)  # another sun needs no other kernel
    frame = mi.Frame3f(axis)
    local = mi.Vector3f(sine * np.cos(angle), sine * np.sin(angle), cosine)
    return np.array(frame.to_world(local)).T


def _evaluate(
    sun: Float[np.ndarray, "3"],
    turbidity: float,
    directions: Float[np.ndarray, "*shape 3"],
    **scales: float,
) -> Float[np.ndarray, "*shape 3"]:
    """Radiance of ``sunsky``; its RGB fit, negative near a setting sun, is cut off at zero."""
    emitter = mi.load_dict(
        {"type": "sunsky", "sun_direction": sun.tolist(), "turbidity": turbidity, **scales}
    )
    flat = directions.reshape(-1, 3)
    si = dr.zeros(mi.SurfaceInteraction3f, len(flat))
    si.wi = -mi.Vector3f(*(mi.Float(axis) for axis in flat.T))
    radiance = np.array(emitter.eval(si), dtype=np.float64).T
    return radiance.clip(min=0.0).reshape(directions.shape)
