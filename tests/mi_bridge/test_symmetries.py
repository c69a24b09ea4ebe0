"""Laws that hold in every scene, tried in random ones: mirrors, sums of light, units, split meshes.

One scene in each test run; ``-m slow`` draws 300, in clear air.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cnca.effects.plan import Demand
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.scene.cameras import View, orbit_view
from cnca.scene.materials import Material
from cnca.scene.weather import Fog, Weather
from cnca.vehicle.builtin.props import box
from cnca.vehicle.model import Part, Vehicle

MANY = 60
"""Scenes of each law in the slow tests."""
SIDE, SAMPLES, TEXELS = 12, 32, 4
SEEDS = 6
"""Pictures from which the noise is estimated where two do not share their random numbers."""
DIFFERENT = 6.0
"""Standard errors that one of 48 means exceeds once in some ten thousand scenes."""


@dataclass(frozen=True)
class Drawn:
    """One random scene: a painted box, a thing beside it, ground, sun, sky and perhaps fog."""

    vehicle: Vehicle
    weather: Weather
    view: View
    ground: float
    texture: torch.Tensor

    def looks(self, seeds: Sequence[int]) -> list[tuple[np.ndarray, np.ndarray]]:
        """Radiance (3, height, width) and the gradient of its mean (3, texels, texels)."""
        ground = (self.ground,) * 3
        renderer = MitsubaRenderer(self.vehicle, ground_albedo=ground, texture_size=TEXELS)
        return [self._look(renderer, seed) for seed in seeds]

    def look(self) -> tuple[np.ndarray, np.ndarray]:
        """As :meth:`looks`."""
        return self.looks([0])[0]

    def _look(self, renderer: MitsubaRenderer, seed: int) -> tuple[np.ndarray, np.ndarray]:
        demand = Demand(forced={"samples": SAMPLES})
        texture = self.texture.clone().requires_grad_()
        views = [self.view]
        plan = renderer.plan(texture, views, self.weather, demand=demand)
        white = renderer.built.lit(plan, views, "geometry")[2]
        models = (str(plan[name]) for name in ("sun", "sky", "fog", "lamps"))
        white *= renderer.built.atmosphere(plan.weather, *models).unit
        image = renderer.render(texture, views, self.weather, seed=seed, demand=demand)[0] * white
        image.mean().backward()
        assert texture.grad is not None
        return image.detach().double().numpy(), texture.grad.double().numpy()


def moved(part: Part, x: float, y: float) -> Part:
    return replace(part, vertices=part.vertices + np.array([x, y, 0.0]))


@st.composite
def scenes(draw: Callable, *, foggy: bool | None = None) -> Drawn:
    def number(low: float, high: float) -> float:
        return draw(st.floats(low, high).map(lambda value: round(value, 3)))

    size = np.array([number(1, 5), number(1, 3), number(0.5, 2.5)])
    beside = moved(box(np.array([1.0, 0.7, number(0.3, 2.5)])), number(-3, 3), number(2, 4))
    # Paints that are all coated and a little metallic share their kernels.
    coat, metal = number(0.05, 1), number(0.05, 0.8)
    paint = Material((0.5, 0.5, 0.5), number(0.1, 1), clearcoat=coat, metallic=metal)
    vehicle = Vehicle("drawn", (box(size), replace(beside, material="trim", uvs=None)), paint)
    in_fog = draw(st.booleans()) if foggy is None else foggy
    fog = Fog(number(20, 2000), height=number(5, 80), albedo=number(0.8, 1)) if in_fog else None
    weather = Weather(number(3, 85), number(0, 360), number(2, 8), fog=fog)
    view = orbit_view(number(0, 360), number(5, 60), number(8, 14), fov=40, width=SIDE, height=SIDE)
    rng = np.random.default_rng(draw(st.integers(0, 99)))
    texture = torch.from_numpy(rng.uniform(0.05, 0.95, (3, TEXELS, TEXELS))).float()
    return Drawn(vehicle, weather, view, number(0.05, 0.8), texture)


def one_scene() -> Drawn:
    """The one that every test run tries."""
    beside = replace(moved(box(np.array([1.0, 0.7, 1.2])), 1.0, 2.5), material="trim", uvs=None)
    paint = Material((0.5, 0.5, 0.5), 0.4, clearcoat=0.5, metallic=0.2)
    view = orbit_view(50.0, 25.0, 9.0, fov=40, width=SIDE, height=SIDE)
    rng = np.random.default_rng(0)
    texture = torch.from_numpy(rng.uniform(0.05, 0.95, (3, TEXELS, TEXELS))).float()
    vehicle = Vehicle("one", (box(np.array([3.0, 2.0, 1.5])), beside), paint)
    return Drawn(vehicle, Weather(40.0, 120.0, 3.0), view, 0.3, texture)


def tried(strategy: st.SearchStrategy) -> Callable:
    """A law in one scene and, slowly, in many."""

    def decorate(law: Callable[[Drawn], None]) -> Callable:
        @pytest.mark.parametrize("drawn", [False, pytest.param(True, marks=pytest.mark.slow)])
        def test(drawn: bool) -> None:
            if not drawn:
                law(one_scene())
                return

            @settings(
                max_examples=MANY,
                deadline=None,
                derandomize=True,
                database=None,
                suppress_health_check=list(HealthCheck),
            )
            @given(strategy)
            def run(drawn: Drawn) -> None:
                law(drawn)

            run()

        test.__doc__ = law.__doc__
        return test

    return decorate


def assert_same(found: np.ndarray, expected: np.ndarray, share: float = 1.0) -> None:
    """Equal but for rounding, in so many of the numbers: a ray that grazes an edge may miss it."""
    scale = np.abs(expected).mean() + 1e-12
    close = np.abs(found - expected) <= 2e-3 * (np.abs(expected) + scale)
    assert close.mean() >= share, f"{1 - close.mean():.1%} differ"


def assert_alike(found: list[np.ndarray], expected: list[np.ndarray]) -> None:
    """Equal but for noise, in means over 4 × 4 blocks of independent pictures."""
    a, b = (np.array([blocks(picture) for picture in pictures]) for pictures in (found, expected))
    error = np.sqrt((a.var(axis=0, ddof=1) + b.var(axis=0, ddof=1)) / len(a))
    # Blocks without noise, such as those of the sky, agree to rounding.
    error = np.hypot(error, 1e-3 * np.abs(b).mean(axis=0) + 1e-4 * np.abs(b).mean())
    # Few pictures know their own noise badly: take the mean of all blocks for the least.
    error = np.maximum(error, np.median(error))
    z = np.abs(a.mean(axis=0) - b.mean(axis=0)) / error
    assert z.max() < DIFFERENT, f"{z.max():.1f} standard errors apart"


def blocks(picture: np.ndarray) -> np.ndarray:
    channels, height, width = picture.shape
    return picture.reshape(channels, height // 4, 4, width // 4, 4).mean(axis=(2, 4))


@tried(scenes(foggy=False))
def test_a_mirrored_scene_has_the_mirrored_picture(drawn: Drawn) -> None:
    """About the plane y = 0, of which nothing knows but the scene."""

    def mirror(part: Part) -> Part:
        flip = np.array([1.0, -1.0, 1.0])
        return replace(
            part,
            vertices=part.vertices * flip,
            normals=part.normals * flip,
            faces=part.faces[:, ::-1].copy(),
        )

    view = drawn.view
    flipped = (
        replace(view, origin=_flip(view.origin), target=_flip(view.target), up=_flip(view.up)),
        replace(drawn.vehicle, parts=tuple(mirror(part) for part in drawn.vehicle.parts)),
    )
    mirrored = replace(
        drawn,
        view=flipped[0],
        vehicle=flipped[1],
        weather=replace(drawn.weather, sun_azimuth=-drawn.weather.sun_azimuth),
    )
    original = drawn.looks(range(SEEDS))
    images = mirrored.looks(range(SEEDS, 2 * SEEDS))
    assert_alike([image[:, :, ::-1] for image, _ in images], [image for image, _ in original])
    assert_alike([slope for _, slope in images], [slope for _, slope in original])


def _flip(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    x, y, z = vector
    return x, -y, z


@tried(scenes(foggy=False))
def test_light_is_the_sum_of_sun_and_sky(drawn: Drawn) -> None:
    """Radiance and gradient of both together, on the same paths; in fog paths depend on light."""
    light = drawn.weather
    both, sun, sky = (
        replace(drawn, weather=replace(light, sun_scale=a, sky_scale=b)).look()
        for a, b in ((1.0, 1.0), (1.0, 0.0), (0.0, 1.0))
    )
    for whole, first, second in zip(both, sun, sky, strict=True):
        assert_same(first + second, whole, share=0.97)


@tried(scenes(foggy=False))
def test_twice_the_light_is_twice_the_radiance(drawn: Drawn) -> None:
    """And so the same exposed picture."""
    light = drawn.weather
    brighter = replace(drawn, weather=replace(light, sun_scale=2.0, sky_scale=2.0))
    for once, twice in zip(drawn.look(), brighter.look(), strict=True):
        assert_same(twice, 2 * once)


@tried(scenes(foggy=False))
def test_no_picture_depends_on_the_unit_of_length(drawn: Drawn) -> None:
    """Everything twice as large, the fog's layer and visibility too."""

    def larger(part: Part) -> Part:
        return replace(part, vertices=2 * part.vertices)

    fog, view = drawn.weather.fog, drawn.view
    if fog is not None:
        fog = replace(fog, visibility=2 * fog.visibility, height=2 * fog.height)
    origin, target = ([2 * value for value in v] for v in (view.origin, view.target))
    scaled = replace(
        drawn,
        vehicle=replace(drawn.vehicle, parts=tuple(larger(part) for part in drawn.vehicle.parts)),
        view=replace(view, origin=tuple(origin), target=tuple(target)),
        weather=replace(drawn.weather, fog=fog),
    )
    for once, twice in zip(drawn.look(), scaled.look(), strict=True):
        assert_same(twice, once, share=0.97)


@tried(scenes(foggy=False))
def test_a_mesh_that_is_split_looks_the_same(drawn: Drawn) -> None:
    """Its triangles in two parts of the same material, and cut in four."""
    first, *others = drawn.vehicle.parts
    halves = [
        replace(first, name=f"half {start}", faces=first.faces[start::2].copy())
        for start in range(2)
    ]
    split = replace(drawn, vehicle=replace(drawn.vehicle, parts=(*halves, *others)))
    for whole, parts in zip(drawn.look(), split.look(), strict=True):
        assert_same(parts, whole, share=0.97)
