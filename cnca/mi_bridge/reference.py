"""The same scene by Mitsuba's own volumetric path tracer: slow, and right where ours neglects.

Mitsuba's emitters light it and its random walk carries the fog, so that nothing but geometry and
materials is shared with our integrator.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cnca.mi_bridge.light import Light
from cnca.mi_bridge.rays import Cameras, average_samples
from cnca.mi_bridge.variant import dr, mi
from cnca.scene.weather import Fog

LAYER_HALF_WIDTH = 3000.0
"""Metres; the fog's box must end, far beyond every visibility that matters."""
BELOW_GROUND = 1.0
DEPTH, RUSSIAN_ROULETTE = 128, 64
"""Longest path, and where it may end by chance: 16 % of the light is lost at 16 in dense fog."""


def as_envmap(sky: Float[np.ndarray, "rows columns 3"]) -> dict:
    """Our sky map as Mitsuba's ``envmap``: y up, φ from −z to +x, here turned to z up."""
    columns = sky.shape[1]
    order = (columns // 4 - 1 - np.arange(columns)) % columns
    turned = mi.ScalarTransform4f(
        np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])
    )
    bitmap = mi.Bitmap(np.ascontiguousarray(sky[:, order], dtype=np.float32))
    return {"type": "envmap", "bitmap": bitmap, "to_world": turned}


def lit_by_mitsuba(scene: mi.Scene, light: Light, **more: mi.Object) -> mi.Scene:
    """The shapes of ``scene`` under a directional sun and an environment map."""
    shapes = {f"shape_{i}": shape for i, shape in enumerate(scene.shapes())}
    sun = {
        "type": "directional",
        "direction": (-light.sun_direction).tolist(),
        "irradiance": {"type": "rgb", "value": light.sun_irradiance.tolist()},
    }
    lights = {"sky": as_envmap(light.sky)} if light.sky.any() else {}
    lights |= {"sun": sun} if light.sun_irradiance.any() else {}
    return mi.load_dict({"type": "scene", **lights, **shapes, **more})


def in_fog(scene: mi.Scene, light: Light, fog: Fog) -> tuple[mi.Scene, mi.Medium]:
    """The lit scene in a wide box of droplets, and the medium that a camera inside of it needs."""
    medium = mi.load_dict(
        {
            "type": "homogeneous",
            "albedo": fog.albedo,
            "sigma_t": fog.extinction,
            "phase": {"type": "hg", "g": fog.asymmetry},
        }
    )
    half = (fog.height + BELOW_GROUND) / 2
    to_world = mi.ScalarTransform4f().translate([0, 0, fog.height - half])
    to_world = to_world @ mi.ScalarTransform4f().scale([LAYER_HALF_WIDTH, LAYER_HALF_WIDTH, half])
    layer = {"type": "cube", "to_world": to_world, "bsdf": {"type": "null"}, "interior": medium}
    return lit_by_mitsuba(scene, light, layer=layer), medium


def mitsuba_picture(
    scene: mi.Scene,
    integrator: dict,
    cameras: Cameras,
    *,
    samples: int,
    seed: int,
    medium: mi.Medium | None = None,
) -> Float[np.ndarray, "views height width 3"]:
    """Linear radiance by one of Mitsuba's integrators, through our cameras."""
    ray, _ = cameras.rays(samples, dr.opaque(mi.UInt32, seed))
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(mi.UInt32(seed), cameras.lanes(samples))
    ray = mi.RayDifferential3f(ray)
    radiance, _, _ = mi.load_dict(integrator).sample(scene, sampler, ray, medium)
    dr.eval(radiance)
    channels = [np.array(average_samples(c, samples)) for c in mi.Color3f(radiance)]
    return np.stack(channels, axis=-1).reshape(*cameras.film_shape, 3)


def volpath_picture(
    scene: mi.Scene, light: Light, fog: Fog, cameras: Cameras, *, samples: int, seed: int
) -> Float[np.ndarray, "views height width 3"]:
    """Linear radiance by ``volpath``, the cameras inside the layer."""
    reference, medium = in_fog(scene, light, fog)
    integrator = {"type": "volpath", "max_depth": DEPTH, "rr_depth": RUSSIAN_ROULETTE}
    return mitsuba_picture(
        reference, integrator, cameras, samples=samples, seed=seed, medium=medium
    )
