"""Paint against Burley's closed forms under a single light, and mirrors against Fresnel's law."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from jaxtyping import Float

from cnca.core.color import srgb_to_linear
from cnca.mi_bridge.geometry import ALBEDO_FLOOR
from cnca.scene.materials import Material
from tests.hard.looks import DIFFERENT, SEEDS, Look, load, look, pixel_directions, sky_towards

UP = np.array([0.0, 0.0, 1.0])
INDEX = 1.5
"""Refractive index that Burley's specular of 0.5 stands for."""


def burley(
    material: Material,
    albedo: Float[np.ndarray, "3"],
    to_light: Float[np.ndarray, "3"],
    to_eye: Float[np.ndarray, "*pixels 3"],
) -> Float[np.ndarray, "*pixels 3"]:
    """BRDF of a level surface: "Physically Based Shading at Disney" (2012), sections 5.3 to 5.6."""
    half = to_light + to_eye
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    l, v, h = to_light @ UP, (to_eye @ UP)[..., None], (half @ UP)[..., None]  # noqa: E741
    d = (half @ to_light)[..., None]

    def grazing(cosine: np.ndarray) -> np.ndarray:
        return (1 - cosine) ** 5

    at_90 = 0.5 + 2 * material.roughness * d**2
    diffuse = albedo / np.pi * (1 + (at_90 - 1) * grazing(l)) * (1 + (at_90 - 1) * grazing(v))

    α = material.roughness**2
    spread = α**2 / (np.pi * (1 + (α**2 - 1) * h**2) ** 2)
    metal = albedo + (1 - albedo) * grazing(d)
    gloss = spread * shadowing(l, α) * shadowing(v, α) / (4 * l * v)

    a = 0.1 + (0.001 - 0.1) * material.clearcoat_gloss
    lacquer_spread = (a**2 - 1) / (np.pi * np.log(a**2) * (1 + (a**2 - 1) * h**2))
    fresnel = 0.04 + 0.96 * grazing(d)
    lacquer = fresnel * lacquer_spread * shadowing(l, 0.25) * shadowing(v, 0.25) / 4

    m = material.metallic
    reflected = m * metal + (1 - m) * dielectric(d)
    return (1 - m) * diffuse + reflected * gloss + material.clearcoat * lacquer


def shadowing(cosine: np.ndarray, α: float) -> np.ndarray:
    """Smith's shadowing for GGX (Walter et al. 2007, equation 34)."""
    return 2 / (1 + np.sqrt(1 + α**2 * (1 / cosine**2 - 1)))


def dielectric(cosine: np.ndarray) -> np.ndarray:
    """Fresnel's equations for unpolarised light, from outside."""
    inside = np.sqrt(1 - (1 - cosine**2) / INDEX**2)
    s = (cosine - INDEX * inside) / (cosine + INDEX * inside)
    p = (INDEX * cosine - inside) / (INDEX * cosine + inside)
    return (s**2 + p**2) / 2


def paint(name: str) -> tuple[Material, Float[np.ndarray, "3"]]:
    vehicle = load(name).vehicle
    finish = vehicle.finish.model_dump()
    linear = srgb_to_linear(torch.tensor(vehicle.paint)).double().numpy()
    return Material((0, 0, 0), **finish), ALBEDO_FLOOR + (1 - ALBEDO_FLOOR) * linear


@pytest.mark.parametrize(
    "name", ["paint_roughness_1", "paint_metal", "paint_clear_coat", "sun_alone"]
)
def test_sunlit_paint_is_burleys(name):
    """The sun stands in the zenith of a black sky; each pixel shows a level roof."""
    seen = look(name)
    light, towards = seen.light, pixel_directions(seen.views[0])
    expected = burley(*paint(name), light.sun_direction, -towards) * light.sun_irradiance
    found = seen.image[0].transpose(1, 2, 0)
    # Rays pass up to half a pixel, 0.1°, beside the pixel's centre.
    np.testing.assert_allclose(found, expected, rtol=0.01)


def mirrored_sky(seen: Look) -> Float[np.ndarray, "height width 3"]:
    towards = pixel_directions(seen.views[0])
    return sky_towards(seen.light.sky, towards * [1, 1, -1])


def assert_mean(seen: Look, expected: np.ndarray) -> None:
    """The pictures' mean is ``expected`` within noise and 1 % for the sky's texels of 1.4°."""
    means = seen.images.mean(axis=(1, 3, 4))
    error = means.std(axis=0, ddof=1) / np.sqrt(SEEDS)
    np.testing.assert_array_less(
        np.abs(means.mean(axis=0) - expected), DIFFERENT * error + 0.01 * expected
    )


def test_polished_metal_shows_the_sky():
    seen = look("paint_mirror")
    assert_mean(seen, mirrored_sky(seen).mean(axis=(0, 1)))


def test_polished_black_paint_shows_the_sky_by_fresnels_law():
    seen = look("paint_roughness_0")
    share = dielectric(-pixel_directions(seen.views[0])[..., 2:])
    floor = ALBEDO_FLOOR * seen.light.sky[-1, 0] / seen.ground_albedo  # black paint is not quite
    assert_mean(seen, (share * mirrored_sky(seen)).mean(axis=(0, 1)) + floor)
