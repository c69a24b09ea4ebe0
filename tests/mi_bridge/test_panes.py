"""Windows that let light through: sunlight and paths pass them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from cnca import build
from cnca.core.errors import CncaError
from cnca.effects.plan import Demand
from cnca.mi_bridge.light import make_light
from cnca.mi_bridge.panes import MOST_PANES
from cnca.mi_bridge.rays import Cameras
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.mi_bridge.sky import Sky
from cnca.mi_bridge.surroundings import Surroundings
from cnca.mi_bridge.variant import mi
from cnca.mi_bridge.volpath import lit_by_mitsuba, mitsuba_picture
from cnca.scene.cameras import View
from cnca.scene.materials import MATERIALS
from cnca.scene.schema import Scene
from cnca.scene.weather import Fog, Weather
from cnca.vehicle.model import Vehicle
from tests.mi_bridge.conftest import BOX, box, orbit
from tests.mi_bridge.tracing import diffuse, picture

GLASS, WHITE, TRANSMISSION = 1.5, 0.8, 0.7


def glazed(panes: int, light) -> tuple[mi.Scene, Surroundings]:
    """White ground under level panes that cover the sky, the sun alone."""
    wide = mi.ScalarTransform4f().scale([1000, 1000, 1])
    shapes = {"ground": {"type": "disk", "to_world": wide, "bsdf": diffuse(WHITE)}}
    glass = {"type": "thindielectric", "int_ior": GLASS, "specular_transmittance": TRANSMISSION}
    for i in range(panes):
        at = mi.ScalarTransform4f().translate([0, 0, 2 + 0.1 * i]) @ wide
        shapes[f"pane_{i}"] = {"type": "disk", "to_world": at, "bsdf": glass}
    around = Surroundings(Sky(light, has_map=False), None, panes=True)
    return mi.load_dict({"type": "scene", **shapes}), around


def transmittance(angle: float) -> float:
    """Of a pane by Fresnel's equations, with all reflections between its two sides."""
    inside = np.arcsin(np.sin(angle) / GLASS)
    a, b = np.cos(angle), np.cos(inside)
    s, p = (a - GLASS * b) / (a + GLASS * b), (b - GLASS * a) / (b + GLASS * a)
    once = (s**2 + p**2) / 2
    return (1 - once) / (1 + once) * TRANSMISSION


@pytest.mark.parametrize("altitude", [80.0, 30.0, 5.0])
@pytest.mark.parametrize("panes", [1, 3])
def test_sunlight_on_ground_under_glass_is_what_fresnel_lets_through(altitude, panes):
    """Seen from below the panes: E cos θ T(θ)ⁿ ρ/π, and what the panes throw back to the ground."""
    light = make_light(Weather(sun_altitude=altitude, sky_scale=0), np.zeros(3))
    scene, around = glazed(panes, light)
    view = View("below", (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), 20.0, 8, 8)
    found = picture(scene, around, [view], samples=16, bounces=1)[0]
    angle = np.radians(90 - altitude)
    arriving = light.sun_irradiance * np.cos(angle) * transmittance(angle) ** panes
    np.testing.assert_allclose(found.mean(axis=(0, 1)), arriving * WHITE / np.pi, rtol=2e-3)


def test_behind_too_many_panes_it_is_dark():
    light = make_light(Weather(sun_altitude=60, sky_scale=0), np.zeros(3))
    scene, around = glazed(MOST_PANES + 1, light)
    view = View("below", (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), 20.0, 4, 4)
    assert picture(scene, around, [view], bounces=1).max() == 0


@pytest.fixture(scope="module")
def cabin() -> Vehicle:
    """A painted box in a larger one of clear glass."""
    outer = replace(box(np.array(BOX) * 1.5), material="glass", name="glass")
    clear = replace(MATERIALS["glass"], transmission=TRANSMISSION)
    return Vehicle("cabin", (box(BOX), outer), glass=clear)


@pytest.fixture(scope="module")
def renderer(cabin) -> MitsubaRenderer:
    return MitsubaRenderer(cabin, texture_size=8, samples=64, bounces=3)


def test_paint_behind_glass_agrees_with_volpath(renderer):
    """Mitsuba's volumetric path tracer lets shadow rays pass panes as well."""
    light = make_light(Weather(sun_altitude=40, sun_azimuth=75), renderer.ground_albedo)
    rng = np.random.default_rng(0)
    renderer.geometry.bind(mi.TensorXf(rng.uniform(0.1, 0.9, (8, 8, 3)).astype(np.float32)))
    scene, view, runs = renderer.geometry.scene, orbit(35, 15, 6), 8
    around = Surroundings(Sky(light), None, panes=True)
    reference = lit_by_mitsuba(scene, light)
    # Panes count as reflections there.
    volpath = {"type": "volpath", "max_depth": 32, "rr_depth": 100}
    where = renderer.vehicle_mask([view])[0] == 1
    means = np.zeros((2, runs))
    for seed in range(runs):
        ours = picture(scene, around, [view], samples=64, bounces=16, seed=seed)[0]
        cameras = Cameras([view])
        theirs = mitsuba_picture(reference, volpath, cameras, samples=64, seed=50 + seed)[0]
        means[:, seed] = ours[where].mean(), theirs[where].mean()
    error = np.hypot(*means.std(axis=1, ddof=1)) / np.sqrt(runs) / means[1].mean()
    assert error < 0.01
    assert abs(means[0].mean() / means[1].mean() - 1) < 3 * error


@pytest.mark.parametrize("fog", [None, Fog(visibility=30)], ids=["clear", "fog"])
def test_gradient_of_paint_behind_glass_is_that_of_differences(renderer, fog):
    view, weather, step = orbit(35, 15, 6), Weather(fog=fog), 0.05

    def mean(value: torch.Tensor) -> torch.Tensor:
        albedo = torch.full((3, 8, 8), 0.5) + value
        return renderer.render(albedo, [view], weather, seed=1).mean()

    at = torch.zeros((), requires_grad=True)
    mean(at).backward()
    with torch.no_grad():
        difference = (mean(torch.tensor(step)) - mean(torch.tensor(-step))) / (2 * step)
    assert at.grad is not None
    # The adjoint has noise of its own: 2 % is what the bridge is held to.
    assert float(at.grad) == pytest.approx(float(difference), rel=0.02)


def test_glass_is_dark_unless_the_scene_says_otherwise(cabin):
    view, albedo = [orbit(35, 15, 6)], torch.full((3, 8, 8), 0.5)

    def plan(vehicle: Vehicle, **forced: str):
        demand = Demand(forced=forced)
        tracer = MitsubaRenderer(vehicle, texture_size=8, demand=demand)
        return tracer, tracer.plan(albedo, view, Weather())

    tracer, chosen = plan(replace(cabin, glass=MATERIALS["glass"]))
    assert (chosen["glass"], tracer.geometry.has_panes) == ("dark", False)
    tracer, chosen = plan(cabin)
    assert (chosen["glass"], tracer.geometry.has_panes) == ("pane", True)
    tracer, chosen = plan(cabin, glass="dark")
    tracer.render(albedo, view, Weather(), seed=0)
    assert (chosen["glass"], tracer.geometry.has_panes) == ("dark", False)


@pytest.mark.parametrize("backend", ["raster", "cached"])
def test_other_backends_refuse_clear_glass(backend):
    scene = Scene.model_validate({"vehicle": {"glass_transmission": 0.5, "texture_size": 16}})
    vehicle = build.build_vehicle(scene)
    paint = build.build_paint(scene, vehicle)
    with pytest.raises(CncaError, match="glass_transmission"):
        build.build_loop_renderer(scene, vehicle, paint, backend=backend, samples=1)
