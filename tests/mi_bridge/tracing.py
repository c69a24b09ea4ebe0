"""Pictures by the path tracer alone, of any Mitsuba scene."""

from __future__ import annotations

import numpy as np

from cnca.mi_bridge.fog import solve_fog
from cnca.mi_bridge.fog_layer import FogLayer
from cnca.mi_bridge.forward import ForwardShare
from cnca.mi_bridge.geometry import Geometry
from cnca.mi_bridge.integrator import trace
from cnca.mi_bridge.light import Light
from cnca.mi_bridge.rays import Cameras, average_samples
from cnca.mi_bridge.sky import Sky
from cnca.mi_bridge.surroundings import Surroundings
from cnca.mi_bridge.variant import dr, mi
from cnca.scene.weather import Fog


def surroundings(
    light: Light,
    fog: Fog | None = None,
    ground: float = 0.0,
    geometry: Geometry | None = None,
) -> Surroundings:
    sky = Sky(light)
    if fog is None:
        return Surroundings(sky, None)
    forward = ForwardShare(geometry, fog.asymmetry) if geometry else None
    field = solve_fog(fog, light, np.full(3, ground))
    return Surroundings(sky, FogLayer(fog, field, sky, forward))


def sampler_for(lanes: int, seed: int) -> mi.Sampler:
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(mi.UInt32(seed), lanes)
    return sampler


def picture(scene, around, views, *, samples=64, bounces=4, seed=0) -> np.ndarray:
    """Linear radiance (views, height, width, 3)."""
    cameras = Cameras(views)
    ray, first = cameras.rays(samples, dr.opaque(mi.UInt32, seed))
    sampler = sampler_for(cameras.lanes(samples), seed)
    radiance, _ = trace(scene, around, sampler, ray, first, bounces=bounces)
    return pixels(radiance, cameras, samples)


def pixels(radiance: mi.Color3f, cameras: Cameras, samples: int) -> np.ndarray:
    dr.eval(radiance)
    colors = [np.array(average_samples(channel, samples)) for channel in radiance]
    return np.stack(colors, axis=-1).reshape(cameras.count, cameras.height, cameras.width, 3)


def diffuse(reflectance: float) -> dict:
    return {
        "type": "twosided",
        "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [reflectance] * 3}},
    }
