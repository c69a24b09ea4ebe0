"""Path-traced shading that is kept: the paint's gloss, and the light that its texture multiplies.

Base color is linear in the BSDF, so the radiance of a camera ray that meets paint is

    L = airlight + T · (specular + irradiance · texel),

T the fog's transmittance.  Specular and irradiance hold shadows, sky, fog and the light that other
surfaces reflect, those in the texture that was bound when they were traced: what a new texture
throws on itself and on its surroundings is missing until they are traced again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from scipy.sparse import csr_array

from cnca.core.types import LinearTexture
from cnca.mi_bridge.affine import AffinePicture, texel_weights
from cnca.mi_bridge.backgrounds import BACKGROUND_SEED, KeptBackgrounds
from cnca.mi_bridge.bridge import Shot
from cnca.mi_bridge.geometry import ALBEDO_FLOOR
from cnca.mi_bridge.integrator import lamplight, trace
from cnca.mi_bridge.portions import WHOLE, vehicle_part
from cnca.mi_bridge.variant import dr, mi
from cnca.scene.cameras import View
from cnca.scene.weather import Weather

RAYS_AT_ONCE = 2**20
"""Each takes about 250 bytes here, and its sorted texels besides."""


@dataclass(frozen=True)
class _Split:
    """Every sample of some pixels, (pixels, samples, …)."""

    uv: Float[np.ndarray, "pixels samples 2"]
    specular: Float[np.ndarray, "pixels samples 3"]
    """What a black texture leaves; off the paint all radiance."""
    irradiance: Float[np.ndarray, "pixels samples 3"]
    """What a white texture adds."""


class TracedShading:
    """Shades one view by the path tracer, split into texture and all that multiplies it."""

    def __init__(self, kept: KeptBackgrounds, samples: int, *, seed: int = BACKGROUND_SEED) -> None:
        """``samples`` are the rays per pixel of the vehicle."""
        self.kept, self.renderer, self.samples, self.seed = kept, kept.renderer, samples, seed

    @torch.no_grad()
    def __call__(self, view: View, weather: Weather, texture: LinearTexture) -> AffinePicture:
        """The picture of one view, its interreflections those of ``texture``."""
        kept = self.kept.background(view, weather)
        plan = self.renderer.plan(texture, [view], weather, samples=self.samples)
        portion = WHOLE if kept.shares is None else vehicle_part(kept.shares)
        shots = self.renderer.shots(
            plan, [view], kept.pixels, seed=self.seed, most_rays=RAYS_AT_ONCE, portion=portion
        )
        size = self.renderer.geometry.texture_size
        texels = texture.detach().expand(3, size, size).permute(1, 2, 0).float().contiguous()
        bound = mi.TensorXf(texels.numpy())
        specular, weights = np.zeros((len(kept.pixels), 3), np.float32), None
        for shot in shots:
            part, share = split(shot, bound), shot.samples / self.samples
            specular += part.specular.mean(axis=1) * share
            gain = part.irradiance / self.samples
            new = texel_weights(part.uv, gain, size)
            weights = new if weights is None else _sums(weights, new)
        assert weights is not None
        constant = kept.image.permute(1, 2, 0).reshape(-1, 3).numpy().copy()
        constant[kept.pixels] = specular if kept.rest is None else specular + kept.rest.numpy()
        return AffinePicture(constant, kept.pixels, weights)


def split(shot: Shot, texture: mi.TensorXf) -> _Split:
    """Trace a shot and separate what its first hits' texture multiplies; exposed radiance.

    Only the texture of the first hit is taken out: farther ones are ``texture``.
    """
    geometry, context = shot.geometry, mi.BSDFContext()
    geometry.bind(texture)
    with dr.suspend_grad():
        sampler, ray, first_reflection = shot.start(shot.seed)
        si = geometry.scene.ray_intersect(ray)
        hit, bsdf = si.is_valid(), si.bsdf(ray)
        T, airlight = _between(shot, ray, si, sampler)
        to_sun, sunlight = _sunlight(shot, si, sampler)
        lamp = None
        if shot.surroundings.lamps is not None:
            lamp = lamplight(geometry.scene, shot.surroundings, sampler, si, hit)
            dr.eval(lamp.d, lamp.irradiance)
        lobe, across = first_reflection[0], mi.Point2f(*first_reflection[1:])
        reflected, _ = bsdf.sample(context, si, lobe, across, hit)
        ray_next = si.spawn_ray(si.to_world(reflected.wo))
        dr.eval(sampler, si, T, airlight, to_sun, sunlight, reflected, ray_next)
        incoming, _ = trace(
            geometry.scene,
            shot.surroundings,
            sampler,
            ray_next,
            [sampler.next_1d() for _ in first_reflection],
            bounces=shot.bounces - 1,
            reflected=True,
        )
        # A black paint reflects nothing that was sampled for it: divide by the density alone.
        incoming = dr.select(hit & (reflected.pdf > 0), incoming / reflected.pdf, 0)
        painted = geometry.is_painted(si)
        dr.eval(incoming, painted)
        by_level = []
        for level in (0.0, 1.0):
            geometry.bind(mi.TensorXf(np.full(texture.shape, level, np.float32)))
            f_sun = bsdf.eval(context, si, si.to_local(to_sun), hit)
            f = bsdf.eval(context, si, reflected.wo, hit)
            light = f_sun * sunlight + f * incoming
            if lamp is not None:
                light += bsdf.eval(context, si, si.to_local(lamp.d), hit) * lamp.irradiance
            by_level.append(dr.select(hit, light, 0))
            dr.eval(by_level[-1])
        geometry.bind(texture)
        black, white = by_level
        # What was bound is ALBEDO_FLOOR and 1: go on to 0 and 1.
        irradiance = dr.select(painted, (white - black) / (1 - ALBEDO_FLOOR), 0)
        specular = airlight + T * (black - ALBEDO_FLOOR * irradiance)
        weights, lanes = shot.weights(), shot.lanes(ray)
        if lanes is not None:
            weights = dr.select(lanes, weights, 0)
        layers = specular * weights, irradiance * T * weights
    shape = (*shot.cameras.film_shape, shot.samples, -1)
    return _Split(*(np.array(layer).T.reshape(shape) for layer in (si.uv, *layers)))


def _between(
    shot: Shot, ray: mi.Ray3f, si: mi.SurfaceInteraction3f, sampler: mi.Sampler
) -> tuple[mi.Float, mi.Color3f]:
    """Transmittance up to the first hit, and what fog, or the sky behind, adds to the ray."""
    sky, fog = shot.surroundings.sky, shot.surroundings.fog
    T, light = mi.Float(1), mi.Color3f(0)
    if fog is not None:
        in_fog = shot.surroundings.sun_in_fog(shot.geometry.scene)
        T, light = fog.segment(ray, si, sampler.next_1d(), mi.Bool(True), in_fog)
    behind = T * sky.radiance(ray.d, ~si.is_valid())
    return T, light + dr.select(si.is_valid(), 0, behind)


def _sunlight(
    shot: Shot, si: mi.SurfaceInteraction3f, sampler: mi.Sampler
) -> tuple[mi.Vector3f, mi.Color3f]:
    """Direction to the sun, and its irradiance on a surface there that faces it."""
    sky, fog = shot.surroundings.sky, shot.surroundings.fog
    if not sky.has_sun:
        return mi.Vector3f(0, 0, 1), mi.Color3f(0)
    to_sun = sky.to_sun(sampler, si.is_valid())
    shadow = shot.geometry.scene.ray_test(si.spawn_ray(to_sun), si.is_valid())
    light = mi.Color3f(sky.sun_irradiance)
    if fog is not None:
        light = light * fog.sun_transmittance(si.p.z)
    if shot.surroundings.probe is not None:
        light = light * shot.surroundings.probe.sun_share(si.p, si.is_valid())
    return to_sun, dr.select(si.is_valid() & ~shadow, light, 0)


def _sums(a: tuple[csr_array, ...], b: tuple[csr_array, ...]) -> tuple[csr_array, ...]:
    return tuple(x + y for x, y in zip(a, b, strict=True))
