"""Hard scenes as pictures and gradients, and a test whether two of them differ beyond noise."""

from __future__ import annotations

import gc
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from unittest import mock

import numpy as np
import torch
from jaxtyping import Float

from cnca import build
from cnca.mi_bridge import bridge
from cnca.mi_bridge.light import Light, lambertian_white, make_light
from cnca.mi_bridge.night import exposure_at_night
from cnca.scene.cameras import View
from cnca.scene.layers import Layers
from cnca.scene.load_scene import load_scene
from cnca.scene.schema import Scene
from cnca.scene.views import build_views
from cnca.scene.weather import Weather

SCENES = Path(__file__).parents[2] / "scenes" / "hard"
NAMES = sorted(path.stem for path in SCENES.glob("*.yaml"))
HUGE = {"texture_4096"}
"""Scenes that are too large for finite differences."""
SEEDS = 12
"""Pictures from which the noise of a scene in NOISY is estimated; others get one."""
NOISY = {
    *("plain", "paint_mirror", "paint_roughness_0"),
    *("fog_visibility_1e9_m", "fog_visibility_50_km", "fog_thin_sheet", "fog_conserving"),
    *("fog_forward", "fog_backward", "fog_sun_grazing", "sun_in_picture"),
    *("mesh_inverted_normals", "mesh_inside_out"),
    *("mesh_pointlike_uvs", "mesh_line_uvs", "mesh_mirrored_uvs"),
    *("world_bare", "world_mirrored", "world_inside_out"),
    *("camera_straight_down", "camera_touching_paint", "camera_telescope"),
}
"""Scenes whose truth holds within noise; besides them those of ``sun_altitude_…``."""
BLOCK = 4
"""Side in pixels of the squares whose means are compared."""
CELLS = 32
"""Side of the grid into which gradients are summed where a multiple of it is larger."""
DIFFERENT = 5.0
"""|z| that 200 means of equal pictures exceed once in 100 comparisons (Student's t, 22 degrees)."""


Series = Float[np.ndarray, "seeds *more"]
"""Results of the seeds 0, 1, …"""


def load(name: str) -> Scene:
    return load_scene(SCENES / f"{name}.yaml")


class Stage:
    """One scene file, ready to render."""

    def __init__(self, name: str):
        gc.collect()  # the materials of scenes that are gone would stay in the next one's kernels
        self.scene = load(name)
        self.weather, self.views = self.scene.weather(), build_views(self.scene)
        vehicle = build.build_vehicle(self.scene)
        self.texture = build.build_paint(self.scene, vehicle).apply()
        self.renderer = build.build_path_tracer(self.scene, vehicle)

    def images(self, texture: torch.Tensor | None = None, seed: int = 0) -> torch.Tensor:
        """Exposed linear pictures (views, 3, height, width), by default of the scene's paint."""
        texture = self.texture if texture is None else texture
        return self.renderer.render(texture, self.views, self.weather, seed=seed)

    def gradient(self, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
        """Pictures, and the derivative of their mean with respect to the texture."""
        texture = self.texture.clone().requires_grad_()
        images = self.images(texture, seed)
        images.mean().backward()
        assert texture.grad is not None
        return images.detach(), texture.grad

    def slope(self, step: torch.Tensor) -> float:
        """Derivative of the pictures' mean along ``step``, by differences with the same paths.

        Exact: with two reflections it is a polynomial of at most second degree in the texture.
        """
        at = [self.images(self.texture + k * step).double().mean() for k in range(3)]
        return float(-1.5 * at[0] + 2 * at[1] - 0.5 * at[2])

    def contrast(self) -> Float[np.ndarray, " views"]:
        """Mean of the picture in white paint minus that in black paint, on the same paths."""
        white, black = (
            self.images(torch.full_like(self.texture, albedo)).double() for albedo in (1.0, 0.0)
        )
        return (white - black).mean(dim=(1, 2, 3)).numpy()


@dataclass(frozen=True)
class Look:
    """What a scene looks like."""

    views: list[View]
    weather: Weather
    ground_albedo: Float[np.ndarray, "3"]
    images: Float[np.ndarray, "seeds views 3 height width"]
    gradients: Float[np.ndarray, "seeds 3 cells cells"]
    contrast: Float[np.ndarray, " views"]
    layers: Layers
    slopes: tuple[float, float]
    """Derivative along one step, by the adjoint pass on the picture's own paths and by differences;
    NaN for HUGE scenes."""

    @property
    def image(self) -> Float[np.ndarray, "views 3 height width"]:
        """The pictures with seed 0."""
        return self.images[0]

    @property
    def light(self) -> Light:
        """Sun and sky above the fog in units of what is shown as 1, white card by day."""
        light = make_light(self.weather, self.ground_albedo)
        white = lambertian_white(light.sky, light.sun_irradiance, light.sun_direction)
        return light.scaled(exposure_at_night(white, self.weather.sun_altitude) / white)


@cache
def look(name: str) -> Look:
    stage = Stage(name)
    huge = name in HUGE
    noisy = name in NOISY or name.startswith("sun_altitude")
    pairs = [stage.gradient(seed) for seed in range(SEEDS if noisy else 1)]
    images, gradients = zip(*pairs, strict=True)
    return Look(
        stage.views,
        stage.weather,
        stage.renderer.ground_albedo,
        np.stack(images),
        np.stack([_pooled(gradient.numpy()) for gradient in gradients]),
        stage.contrast(),
        stage.renderer.layers(stage.views),
        (np.nan, np.nan) if huge else _slopes(stage),
    )


def _slopes(stage: Stage) -> tuple[float, float]:
    """Along random steps, two of which stay inside [0, 1]."""
    step = 0.25 * torch.rand(stage.texture.shape, generator=torch.Generator().manual_seed(0))
    step = torch.where(stage.texture > 0.5, -step, step)
    with mock.patch.object(bridge, "BACKWARD_SEED", 0):
        _, gradient = stage.gradient()
    return float((gradient.double() * step).sum()), stage.slope(step)


def _pooled(gradient: Float[np.ndarray, "3 size size"]) -> Float[np.ndarray, "3 cells cells"]:
    size = gradient.shape[-1]
    cells = CELLS if size % CELLS == 0 else size
    return gradient.reshape(3, cells, size // cells, cells, size // cells).sum(axis=(2, 4))


def largest_z(first: Series, second: Series) -> float:
    """The largest |z| by which two series differ in the mean (Welch's test), pictures in blocks."""
    a, b = (_block_means(s.astype(np.float64)) if s.ndim > 3 else s for s in (first, second))
    variance = a.var(axis=0, ddof=1) / len(a) + b.var(axis=0, ddof=1) / len(b)
    rounding = 1e-5 * np.abs(a).max()  # of pictures without noise
    return float((np.abs(a.mean(axis=0) - b.mean(axis=0)) / np.sqrt(variance + rounding**2)).max())


def _block_means(
    images: Float[np.ndarray, "*more height width"],
) -> Float[np.ndarray, "*more rows columns"]:
    *more, height, width = images.shape
    blocks = images.reshape(*more, height // BLOCK, BLOCK, width // BLOCK, BLOCK)
    return blocks.mean(axis=(-3, -1))


def sky_towards(
    sky: Float[np.ndarray, "rows columns 3"], directions: Float[np.ndarray, "*more 3"]
) -> Float[np.ndarray, "*more 3"]:
    """The sky map's nearest texel towards unit vectors."""
    rows, columns = sky.shape[:2]
    x, y, z = np.moveaxis(directions, -1, 0)
    row = (np.arccos(z.clip(-1, 1)) / np.pi * rows).astype(int).clip(0, rows - 1)
    column = (np.arctan2(y, x) / (2 * np.pi) % 1 * columns).astype(int) % columns
    return sky[row, column]


def pixel_directions(view: View) -> Float[np.ndarray, "height width 3"]:
    """Unit vectors through the pixels' centres, by the pin-hole equations."""
    forward = np.subtract(view.target, view.origin)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, view.up)
    right /= np.linalg.norm(right)
    half = np.tan(np.radians(view.fov / 2))
    x = half * ((np.arange(view.width) + 0.5) * 2 / view.width - 1)
    y = half * ((np.arange(view.height) + 0.5) * 2 - view.height) / view.width
    d = forward + x[None, :, None] * right + y[:, None, None] * np.cross(forward, right)
    return d / np.linalg.norm(d, axis=-1, keepdims=True)
