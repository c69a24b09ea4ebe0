"""A measured environment around the vehicle: what kernels read of it, and how they sample it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from cnca.mi_bridge.latlong import direction_uv, wrap_columns
from cnca.mi_bridge.variant import dr, mi
from cnca.scene.environment import (
    LUMINANCE,
    Environment,
    level_weights,
    sky_solid_angles,
)
from cnca.scene.weather import SkyMap

TABLE_ROWS = 512
"""Most rows of a table that directions are drawn from."""
DIMMEST = 0.25
"""Least part of the mean that a direction is drawn with: dark ones may show bright surfaces."""


@dataclass(frozen=True)
class TurnedMap:
    """A map as it stands around the vehicle."""

    environment: Environment
    gain: float
    """Factor on its radiance."""
    place: SkyMap
    """How it is turned, and from where it was taken."""


class EnvironmentMap:
    """Radiance of a map by direction."""

    def __init__(self, turned: TurnedMap) -> None:
        self.turned = turned
        self._gain = dr.opaque(mi.Float, turned.gain)
        self.rotation = dr.opaque(mi.Float, np.radians(turned.place.rotation % 360))
        self._columns = turned.environment.radiance.shape[1]
        self._texture = _texture(turned.environment)

    def radiance(self, d: mi.Vector3f, active: mi.Bool) -> mi.Color3f:
        """What arrives from the unit vector ``d``, without the sun."""
        uv = direction_uv(_turn(d, -self.rotation), self._columns)
        return self._gain * mi.Color3f(self._texture.eval(uv, active))


class DirectionTable:
    """Directions of the upper half of a map, drawn in proportion to weights of its texels."""

    def __init__(self, weights: Float[np.ndarray, "rows columns"], rotation: mi.Float) -> None:
        """``weights`` of all rows of a map, of which the lower half is not drawn; some are > 0."""
        self._rows, self._columns = weights.shape
        upper = np.ascontiguousarray(weights[: self._rows // 2], dtype=np.float64)
        probability = np.float32(upper / upper.sum())
        self._distribution = mi.DiscreteDistribution2D(probability)
        solid_angles = sky_solid_angles(self._rows, self._columns)[: self._rows // 2]
        self._density = mi.Float(np.float32(probability / solid_angles).ravel())
        self._rotation = rotation

    def sample(self, random: mi.Point2f, active: mi.Bool) -> tuple[mi.Vector3f, mi.Float]:
        """A unit vector and its density per steradian."""
        texel, _, within = self._distribution.sample(random, active)
        top = dr.cos(mi.Float(texel.y) * (dr.pi / self._rows))
        bottom = dr.cos(mi.Float(texel.y + 1) * (dr.pi / self._rows))
        z = dr.lerp(top, bottom, within.y)  # even in solid angle
        sine = dr.safe_sqrt(1 - z * z)
        phi = (mi.Float(texel.x) + within.x) * (dr.two_pi / self._columns) + self._rotation
        d = mi.Vector3f(sine * dr.cos(phi), sine * dr.sin(phi), z)
        index = texel.y * self._columns + texel.x
        return d, dr.gather(mi.Float, self._density, index, active)

    def density(self, d: mi.Vector3f, active: mi.Bool) -> mi.Float:
        """Density per steradian; 0 below the horizon."""
        local = _turn(d, -self._rotation)
        phi = dr.atan2(local.y, local.x)
        phi = dr.select(phi < 0, phi + dr.two_pi, phi)
        column = dr.minimum(mi.UInt32(phi * (self._columns / dr.two_pi)), self._columns - 1)
        row = mi.UInt32(dr.safe_acos(d.z) * (self._rows / dr.pi))
        above = active & (row < self._rows // 2)
        index = row * self._columns + column
        return dr.select(above, dr.gather(mi.Float, self._density, index, above), 0)


class PhotographedGround:
    """Ground at z = 0 that shows the lower half of the map, and catches shadows and bounces.

    With E the irradiance of the whole map on level ground, a point that the map sees along ω has
    the reflectance π L(ω) / E: where nothing stands around, it looks as in the picture.  What the
    vehicle keeps off, and what it reflects, changes it in proportion (Debevec 1998).

    Rays leave it in proportion to what the sky adds to it, and each that escapes brings the same
    light.  So open ground has no noise, and deep shade none; in half-shade all colors lose the
    same share of the sky, their mean: its tint is neglected, and its texels below DIMMEST.
    """

    def __init__(self, sky: EnvironmentMap, ground: mi.Shape) -> None:
        turned, environment = sky.turned, sky.turned.environment
        self.sky, self._ground = sky, mi.ShapePtr(ground)
        dr.make_opaque(self._ground)
        self._height = dr.opaque(mi.Float, turned.place.height)
        self._radius = dr.opaque(mi.Float, turned.place.radius)
        irradiance = turned.gain * level_irradiance(environment)
        self.sky_irradiance = mi.Color3f(*irradiance.tolist())
        # As it was photographed, whatever light is left out now.
        sun = turned.gain * environment.sun_irradiance * environment.sun_direction[2]
        total = irradiance + sun
        inverse = np.where(total > 0, 1 / np.where(total > 0, total, 1.0), 0.0)
        self._inverse = mi.Color3f(*inverse.tolist())
        dr.make_opaque(self.sky_irradiance, self._inverse)
        self.table = _ground_table(turned.environment, sky.rotation)

    def shows(self, si: mi.SurfaceInteraction3f) -> mi.Bool:
        """Which intersections lie on its upper side."""
        return (si.shape == self._ground) & (si.wi.z > 0)

    def ends(self, si: mi.SurfaceInteraction3f) -> mi.Bool:
        """Which of the camera's rays meet it beyond the open ground, or nothing at all."""
        far = dr.square(si.p.x) + dr.square(si.p.y) > dr.square(self._radius)
        return ~si.is_valid() | (self.shows(si) & far)

    def towards(self, ray: mi.Ray3f) -> mi.Vector3f:
        """Where the map shows what a camera sees along its ray: all of it on a dome.

        What stands on the ground would lie on it otherwise. Cameras outside of it see the map
        infinitely far away.
        """
        o, d = ray.o, ray.d
        b = dr.dot(o, d)
        inside = dr.square(self._radius) - dr.squared_norm(o)
        p = o + (dr.safe_sqrt(b * b + inside) - b) * d
        return dr.select(inside > 0, dr.normalize(p - mi.Point3f(0, 0, self._height)), d)

    def evened_sky(self, d: mi.Vector3f, density: mi.Float) -> mi.Color3f:
        """Radiance of the sky along a ray from here that was drawn with that density."""
        return self.sky_irradiance * (density / dr.maximum(d.z, 1e-6))

    def reflected(self, p: mi.Point3f, active: mi.Bool) -> mi.Color3f:
        """BRDF at a point, in 1/sr."""
        d = dr.normalize(mi.Vector3f(p.x, p.y, -self._height))
        return self.sky.radiance(d, active) * self._inverse


def level_irradiance(environment: Environment) -> Float[np.ndarray, "3"]:
    """Irradiance of the sky, without the sun, on level ground."""
    weights = level_weights(*environment.radiance.shape[:2])[..., None]
    return (environment.radiance * weights).sum(axis=(0, 1), dtype=np.float64)


def importance_table(sky: EnvironmentMap) -> DirectionTable:
    """Directions by how bright they are."""
    # Interpolation spreads a bright texel over its neighbors.
    luminance = _reduced(sky.turned.environment.radiance @ LUMINANCE)
    from scipy.ndimage import uniform_filter  # slow to import, and needed for such maps alone

    luminance = uniform_filter(luminance, 3, mode=("nearest", "wrap"))
    return DirectionTable(luminance * sky_solid_angles(*luminance.shape), sky.rotation)


def _ground_table(environment: Environment, rotation: mi.Float) -> DirectionTable:
    """Directions by the share of its light that they add to level ground, the mean of colors."""
    irradiance = level_irradiance(environment)
    shares = environment.radiance @ np.where(irradiance > 0, 1 / np.maximum(irradiance, 1e-300), 0)
    light = _reduced(shares)
    return DirectionTable(light * level_weights(*light.shape), rotation)


def _reduced(
    light: Float[np.ndarray, "fine_rows fine_columns"],
) -> Float[np.ndarray, "rows columns"]:
    """Its means in blocks, none of them 0."""
    light = light.astype(np.float64)
    rows, columns = light.shape
    if rows < 2:
        return np.ones((2, 4))
    step = max(rows // TABLE_ROWS, 1)
    rows, columns = rows // step // 2 * 2, columns // step
    blocks = light[: rows * step, : columns * step]
    light = blocks.reshape(rows, step, columns, step).mean(axis=(1, 3))
    mean = light[: rows // 2].mean()
    return np.maximum(light, DIMMEST * mean) if mean > 0 else np.ones_like(light)


@lru_cache(maxsize=2)
def _texture(environment: Environment) -> mi.Texture2f:
    return mi.Texture2f(wrap_columns(environment.radiance), wrap_mode=dr.WrapMode.Clamp)


def _turn(d: mi.Vector3f, angle: mi.Float) -> mi.Vector3f:
    """Around +z, counter-clockwise."""
    s, c = dr.sincos(angle)
    return mi.Vector3f(c * d.x - s * d.y, s * d.x + c * d.y, d.z)
