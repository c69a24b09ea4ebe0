"""Plain shading, the paper's neural renderer NR: matt paint in sun and sky, and nothing else.

No shadows, gloss, interreflection or fog: what remains is the vehicle's form under the weather's
light.  Visibility and texture coordinates are Mitsuba's first hits.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from cnca.core.types import LinearTexture
from cnca.mi_bridge.affine import AffinePicture, texel_weights
from cnca.mi_bridge.backgrounds import KeptBackgrounds
from cnca.mi_bridge.light import Light, lambertian_white, make_light
from cnca.mi_bridge.night import exposure_at_night
from cnca.mi_bridge.rays import Cameras
from cnca.mi_bridge.variant import dr, mi
from cnca.scene.cameras import Spot, View
from cnca.scene.environment import sky_directions, sky_solid_angles
from cnca.scene.weather import Weather

FILTER_SAMPLES = 64
"""First hits per pixel, over which texture and shading are averaged: with 16 the gradient's texels
are as noisy as the path tracer's of 16 rays."""
COSINE_LOBE = np.repeat([np.pi, 2 * np.pi / 3, np.pi / 4], [1, 3, 5])
"""What a cosine keeps of each spherical harmonic (Ramamoorthi & Hanrahan 2001, equation 8)."""

Vectors = Float[np.ndarray, "points 3"]


class PlainShading:
    """Shades one view: matt paint over a kept background."""

    def __init__(self, kept: KeptBackgrounds) -> None:
        self.kept, self.renderer = kept, kept.renderer
        self._white = lru_cache(self._make_white)

    def __call__(self, view: View, weather: Weather, texture: LinearTexture) -> AffinePicture:
        """The picture of one view; what ``texture`` it will show first makes no difference."""
        kept = self.kept.background(view, weather)
        geometry = self.renderer.geometry
        ray, _ = Cameras([geometry.local(view)], kept.pixels).rays(FILTER_SAMPLES)
        si = geometry.scene.ray_intersect(ray)
        painted = geometry.is_painted(si)
        normal = mi.Vector3f(si.sh_frame.n)
        normal = dr.select(dr.dot(normal, ray.d) < 0, normal, -normal)
        dr.eval(painted, normal, si.uv)
        shape = (len(kept.pixels), FILTER_SAMPLES, -1)
        cover = np.array(painted, np.float32).reshape(shape) / FILTER_SAMPLES
        if kept.shares is not None:
            cover *= kept.shares[:, None, None].astype(np.float32)
        gain = cover * self._white(weather, view.spot)(np.array(normal).T).reshape(shape)
        constant = kept.image.permute(1, 2, 0).reshape(-1, 3).numpy().copy()
        constant[kept.pixels] *= 1 - cover.sum(axis=1)
        uv = np.array(si.uv).T.reshape(shape)
        weights = texel_weights(uv, gain, geometry.texture_size)
        return AffinePicture(constant, kept.pixels, weights)

    def _make_white(self, weather: Weather, spot: Spot) -> Callable[[Vectors], Vectors]:
        renderer, exposure = self.renderer, self.renderer.exposure
        if renderer.worlds is not None:
            light, white = renderer.built.light_at(weather, spot)
        else:
            light = make_light(weather, renderer.ground_albedo)
            white = lambertian_white(light.sky, light.sun_irradiance, light.sun_direction)
            white /= exposure_at_night(white, weather.sun_altitude)
        return matt_white(light.scaled(exposure / white if white > 0 else exposure))


def matt_white(light: Light) -> Callable[[Vectors], Vectors]:
    """Unit normals → radiance of a white matt surface that nothing shades.

    The sky enters by nine spherical harmonics, right to about 1 % of its irradiance.
    """
    rows, columns = light.sky.shape[:2]
    weights = sky_solid_angles(rows, columns)[..., None] * light.sky
    basis = harmonics(sky_directions(rows, columns).reshape(-1, 3))
    sky = basis.T @ weights.reshape(-1, 3)

    def radiance(normals: Vectors) -> Vectors:
        irradiance = (harmonics(normals) * COSINE_LOBE) @ sky
        facing = (normals @ light.sun_direction).clip(min=0)[:, None]
        return (irradiance.clip(min=0) + facing * light.sun_irradiance) / np.pi

    return radiance


def harmonics(directions: Vectors) -> Float[np.ndarray, "points 9"]:
    """The real spherical harmonics of degrees 0, 1 and 2 at unit vectors."""
    x, y, z = directions.T
    polynomials = [np.ones_like(x), y, z, x, x * y, y * z, 3 * z * z - 1, x * z, x * x - y * y]
    squares = np.array([1, 3, 3, 3, 15, 15, 5 / 4, 15, 15 / 4]) / (4 * np.pi)
    return np.stack(polynomials, axis=-1) * np.sqrt(squares)
