"""The same scene by Mitsuba's own volumetric path tracer: slow, and right in what ours neglects.

Mitsuba's emitters light it and its random walk carries the fog, so that nothing but geometry and
materials is shared with our integrator.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from jaxtyping import Float

from cnca.core.errors import NonFiniteError, SceneError
from cnca.core.types import LinearImages, LinearTexture
from cnca.effects.plan import Demand
from cnca.mi_bridge.geometry import ALBEDO_FLOOR, Geometry
from cnca.mi_bridge.light import SUN_HALF_ANGLE, Light
from cnca.mi_bridge.rays import Cameras, average_samples
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.mi_bridge.variant import dr, mi
from cnca.scene.cameras import View
from cnca.scene.weather import Fog, Weather

LAYER_HALF_WIDTH = 3000.0
"""Metres; the fog's box must end, far beyond every visibility that matters."""
BELOW_GROUND = 1.0
DEPTH, RUSSIAN_ROULETTE = 128, 64
"""Longest path, and where it may end by chance: 16 % of the light is lost at 16 in dense fog."""
DARKEST_SKY = 1e-6
"""Of the sky's brightest texel; see :func:`as_envmap`."""
BUBBLE = 0.05
"""Metres of clear air around the camera for ``prbvolpath``, which takes it to be outside of fog."""
SUN_DISTANCE = 1e6
"""Metres: the disc keeps its place in the sky to 0.2° within the whole box of fog."""


def as_envmap(sky: Float[np.ndarray, "rows columns 3"]) -> dict[str, object]:
    """Our sky map as Mitsuba's ``envmap``: y up, φ from −z to +x, here turned to z up.

    No texel is black: where four neighbors are, a random number of exactly 0 leads ``envmap`` to a
    direction that is NaN, and the BSDF's value times no light is NaN too (once in 2²³ samples).
    """
    columns = sky.shape[1]
    order = (columns // 4 - 1 - np.arange(columns)) % columns
    turned = mi.ScalarTransform4f(
        np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])
    )
    floored = np.maximum(sky[:, order], DARKEST_SKY * sky.max())
    bitmap = mi.Bitmap(np.ascontiguousarray(floored, dtype=np.float32))
    return {"type": "envmap", "bitmap": bitmap, "to_world": turned}


def as_sun(light: Light, *, disc: bool) -> dict[str, object]:
    """The sun as one direction, or as a far disc (a sphere's cone is 0.3 % off in float32)."""
    if not disc:
        return {
            "type": "directional",
            "direction": (-light.sun_direction).tolist(),
            "irradiance": {"type": "rgb", "value": light.sun_irradiance.tolist()},
        }
    width = math.tan(SUN_HALF_ANGLE)
    radiance = light.sun_irradiance / (math.pi * width**2)
    where = mi.ScalarTransform4f().look_at(
        origin=(SUN_DISTANCE * light.sun_direction).tolist(),
        target=[0, 0, 0],
        up=np.eye(3)[np.abs(light.sun_direction).argmin()].tolist(),
    )
    return {
        "type": "disk",
        "to_world": where @ mi.ScalarTransform4f().scale([SUN_DISTANCE * width] * 2 + [1]),
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": radiance.tolist()}},
    }


def lit_by_mitsuba(
    scene: mi.Scene, light: Light, *, sun_disc: bool = False, **more: mi.Object
) -> mi.Scene:
    """The shapes of ``scene`` under a sun and an environment map."""
    shapes = {f"shape_{i}": shape for i, shape in enumerate(scene.shapes())}
    lights = {"sky": as_envmap(light.sky)} if light.sky.any() else {}
    lights |= {"sun": as_sun(light, disc=sun_disc)} if light.sun_irradiance.any() else {}
    return mi.load_dict({"type": "scene", **lights, **shapes, **more})


def in_fog(
    scene: mi.Scene, light: Light, fog: Fog, *, sun_disc: bool = False
) -> tuple[mi.Scene, mi.Medium]:
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
    return lit_by_mitsuba(scene, light, sun_disc=sun_disc, layer=layer), medium


def mitsuba_picture(
    scene: mi.Scene,
    integrator: dict[str, object],
    cameras: Cameras,
    *,
    samples: int,
    seed: int,
    medium: mi.Medium | None = None,
) -> Float[np.ndarray, "views height width 3"]:
    """Linear radiance by one of Mitsuba's integrators, through our cameras.

    Raises:
        NonFiniteError: some pixels hold NaN or infinity.
    """
    seed &= 0xFFFFFFFF
    ray, _ = cameras.rays(samples, dr.opaque(mi.UInt32, seed))
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(mi.UInt32(seed), cameras.lanes(samples))
    ray = mi.RayDifferential3f(ray)
    radiance, _, _ = mi.load_dict(integrator).sample(scene, sampler, ray, medium)
    picture = _averaged(radiance, cameras, samples)
    wrong = int((~np.isfinite(picture)).any(axis=-1).sum())
    if wrong:
        views, kind = ", ".join(cameras.names), integrator["type"]
        raise NonFiniteError(f"{kind}: {wrong} pixels of view {views} with seed {seed} not finite")
    return picture


def _averaged(
    radiance: mi.Color3f, cameras: Cameras, samples: int
) -> Float[np.ndarray, "views height width 3"]:
    dr.eval(radiance)
    channels = [np.array(average_samples(c, samples)) for c in mi.Color3f(radiance)]
    return np.stack(channels, axis=-1).reshape(*cameras.film_shape, 3)


def volpath_picture(
    scene: mi.Scene,
    light: Light,
    fog: Fog,
    cameras: Cameras,
    *,
    samples: int,
    seed: int,
    sun_disc: bool = False,
    inside: bool = True,
) -> Float[np.ndarray, "views height width 3"]:
    """Linear radiance by ``volpath``, the cameras ``inside`` the layer or above it."""
    reference, medium = in_fog(scene, light, fog, sun_disc=sun_disc)
    integrator = {"type": "volpath", "max_depth": DEPTH, "rr_depth": RUSSIAN_ROULETTE}
    return mitsuba_picture(
        reference,
        integrator,
        cameras,
        samples=samples,
        seed=seed,
        medium=medium if inside else None,
    )


def exposed_volpath(
    renderer: MitsubaRenderer,
    albedo: LinearTexture,
    view: View,
    weather: Weather,
    *,
    samples: int,
    seed: int,
    demand: Demand | None = None,
) -> LinearImages:
    """What ``volpath`` makes of a view in fog, to compare with what ``renderer`` renders.

    Materials and the sun's width are those of ``demand``, or of the renderer's own.

    Raises:
        SceneError: there is no fog.
        NonFiniteError: a pixel holds NaN or infinity.
    """
    fog = weather.fog
    if fog is None or fog.height == 0:
        raise SceneError("volpath: there is no fog to scatter light; leave volpath out")
    chosen = renderer.plan(albedo, [view], weather, demand=demand)
    shot = renderer.shots(chosen, [view], None, seed=seed)[0]
    texels = shot.geometry.texture_size
    texture = albedo.detach().expand(3, texels, texels).permute(1, 2, 0)
    shot.geometry.bind(mi.TensorXf(texture.numpy()))
    picture = volpath_picture(
        shot.geometry.scene,
        shot.surroundings.sky.light,
        fog,
        shot.cameras,
        samples=samples,
        seed=seed,
        sun_disc=chosen["sun"] == "disc",
        inside=shot.geometry.local(view).origin[2] < fog.height,
    )
    exposed = torch.from_numpy(np.float32(picture * np.array(shot.exposure)))
    return LinearImages(exposed.permute(0, 3, 1, 2))


class PrbVolpath:
    """Mitsuba's differentiable volumetric path tracer with a camera inside of the fog."""

    def __init__(self, geometry: Geometry, light: Light, fog: Fog, view: View) -> None:
        self.geometry = geometry
        foggy, medium = in_fog(geometry.scene, light, fog)
        bubble = {
            "type": "sphere",
            "center": list(geometry.local(view).origin),
            "radius": BUBBLE,
            "bsdf": {"type": "null"},
            "exterior": medium,
        }
        parts = {f"shape_{i}": shape for i, shape in enumerate(foggy.shapes())}
        parts |= {f"light_{i}": light for i, light in enumerate(foggy.emitters())}
        self.scene = mi.load_dict({"type": "scene", **parts, "bubble": bubble})
        self.integrator = mi.load_dict(
            {"type": "prbvolpath", "max_depth": DEPTH, "rr_depth": RUSSIAN_ROULETTE}
        )
        self.cameras = Cameras([geometry.local(view)])

    def picture(self, samples: int, seed: int) -> Float[np.ndarray, "height width 3"]:
        """Linear radiance with the texture that is bound."""
        return _averaged(self._sample(samples, seed), self.cameras, samples)[0]

    def gradient(
        self,
        albedo: Float[np.ndarray, "size size 3"],
        image_gradient: Float[np.ndarray, "height width 3"],
        samples: int,
        seed: int,
    ) -> Float[np.ndarray, "size size 3"]:
        """Gradient for the bound texture's albedo; ``image_gradient`` belongs to the radiance."""
        bound = self.geometry.bind(mi.TensorXf(np.float32(albedo)), differentiable=True)
        pixel = dr.arange(mi.UInt32, self.cameras.lanes(samples)) // samples
        image_gradient = mi.Float(np.float32(image_gradient).ravel())
        δL = dr.gather(mi.Color3f, image_gradient, pixel) / samples
        with dr.suspend_grad():
            self._sample(samples, seed, δL=δL, state=self._sample(samples, seed))
        gradient = dr.grad(bound) * (1 - ALBEDO_FLOOR)
        self.geometry.bind(mi.TensorXf(np.float32(albedo)))  # leave no derivatives behind
        return np.array(gradient)

    def _sample(
        self, samples: int, seed: int, δL: mi.Color3f | None = None, state: mi.Color3f | None = None
    ) -> mi.Color3f:
        """Radiance of every lane; with the adjoint radiance the gradients are accumulated."""
        seed &= 0xFFFFFFFF
        ray, _ = self.cameras.rays(samples, dr.opaque(mi.UInt32, seed))
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(dr.opaque(mi.UInt32, seed), self.cameras.lanes(samples))
        mode = dr.ADMode.Primal if δL is None else dr.ADMode.Backward
        radiance, _, _, _ = self.integrator.sample(
            mode, self.scene, sampler, ray, δL, state, mi.Bool(True)
        )
        dr.eval(radiance)
        return radiance
