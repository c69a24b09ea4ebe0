"""The reference by Mitsuba's ``volpath``: its sky, its sun, and where it must refuse."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from cnca.core.errors import NonFiniteError, SceneError
from cnca.effects.plan import Demand
from cnca.mi_bridge.light import SUN_HALF_ANGLE, make_light, sky_directions
from cnca.mi_bridge.rays import Cameras
from cnca.mi_bridge.sky import Sky
from cnca.mi_bridge.variant import dr, mi
from cnca.mi_bridge.volpath import (
    PrbVolpath,
    as_envmap,
    exposed_volpath,
    lit_by_mitsuba,
    mitsuba_picture,
    volpath_picture,
)
from cnca.scene.cameras import View
from cnca.scene.weather import Fog, Weather
from tests.mi_bridge.conftest import orbit, uniform_light
from tests.mi_bridge.tracing import diffuse

GREY = torch.full((3, 8, 8), 0.5)
WEATHER = Weather(sun_altitude=40, sun_azimuth=75)
ABOVE = View("above", (0.0, 0.0, 3.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 20.0, 4, 4)


@pytest.fixture(scope="module")
def ground() -> mi.Scene:
    wide = mi.ScalarTransform4f().scale([100, 100, 1])
    shape = {"type": "disk", "to_world": wide, "bsdf": diffuse(0.5)}
    return mi.load_dict({"type": "scene", "ground": shape})


def test_the_envmap_is_the_same_sky(ground):
    light = make_light(WEATHER, np.full(3, 0.15))
    scene = lit_by_mitsuba(ground, light)
    d = sky_directions(40, 50).reshape(-1, 3)
    d = mi.Vector3f(*np.float32(d[np.abs(d[:, 2]) > 0.1].T))  # the horizon is a jump
    si = dr.zeros(mi.SurfaceInteraction3f, dr.width(d))
    si.wi = -d
    theirs = np.array(scene.environment().eval(si))
    ours = np.array(Sky(light).radiance(d, mi.Bool(True)))
    np.testing.assert_allclose(ours, theirs, rtol=0.02, atol=0.002 * theirs.max())


def test_a_sky_that_is_half_black_is_sampled_in_finite_directions():
    """Random numbers of exactly 0 meet the corner where ``envmap`` would divide by zero."""
    light = make_light(replace(WEATHER, sky_scale=0.0), np.full(3, 0.15))
    assert (light.sky[:64] == 0).all()
    assert (light.sky[64:] > 0).all()
    ball = {"type": "sphere"}
    sky = mi.load_dict({"type": "scene", "ball": ball, "sky": as_envmap(light.sky)}).environment()
    numbers = np.arange(64, dtype=np.float32) / 64
    x, y = (mi.Float(n.ravel()) for n in np.meshgrid(numbers, numbers))
    found, _ = sky.sample_direction(dr.zeros(mi.Interaction3f, 64**2), mi.Point2f(x, y))
    assert np.isfinite(np.array(found.d)).all()


@pytest.mark.parametrize("disc", [False, True])
@pytest.mark.parametrize("altitude", [60.0, 10.0])
def test_ground_in_the_sun_obeys_lamberts_law(ground, disc, altitude):
    light = make_light(replace(WEATHER, sun_altitude=altitude, sky_scale=0.0), np.zeros(3))
    scene = lit_by_mitsuba(ground, light, sun_disc=disc)
    path = {"type": "path", "max_depth": 2}
    found = mitsuba_picture(scene, path, Cameras([ABOVE]), samples=64, seed=0)
    expected = 0.5 / np.pi * light.sun_irradiance * np.sin(np.radians(altitude))
    # The cosine of a random point of the disc scatters by half of its width over the tangent.
    noise = SUN_HALF_ANGLE / 2 / np.tan(np.radians(altitude)) / np.sqrt(16 * 64) if disc else 0.0
    np.testing.assert_allclose(found.mean(axis=(0, 1, 2)), expected, rtol=2e-5 + 4 * noise)


def test_the_disc_is_as_wide_as_the_suns(ground):
    light = make_light(replace(WEATHER, sky_scale=0.0), np.zeros(3))
    scene = lit_by_mitsuba(ground, light, sun_disc=True)
    across = np.cross(light.sun_direction, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    angles = SUN_HALF_ANGLE * np.array([-1.05, -0.95, 0.0, 0.95, 1.05])
    d = np.cos(angles)[:, None] * light.sun_direction + np.sin(angles)[:, None] * across
    si = scene.ray_intersect(mi.Ray3f(mi.Point3f(0, 0, 1), mi.Vector3f(*np.float32(d.T))))
    assert np.array(si.is_valid()).tolist() == [False, True, True, True, False]


def test_pixels_that_are_not_finite_are_counted_and_refused(ground):
    """A radiance beyond float32 makes every pixel infinite."""
    light = uniform_light(3e38)
    scene = lit_by_mitsuba(ground, light.scaled(1.0))
    path = {"type": "path", "max_depth": 3}
    with pytest.raises(NonFiniteError, match="path: 16 pixels of view above with seed 5"):
        mitsuba_picture(scene, path, Cameras([ABOVE]), samples=4, seed=5)


def test_seeds_wrap_around_at_32_bits(ground):
    """As the loop's renderer takes them: a run's seed times a million soon reaches that."""
    scene = lit_by_mitsuba(ground, make_light(Weather(), np.full(3, 0.4)))
    path = {"type": "path", "max_depth": 2}
    seeds = 5, 5 + 2**32, 6
    first, again, other = (
        mitsuba_picture(scene, path, Cameras([ABOVE]), samples=4, seed=seed) for seed in seeds
    )
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def test_without_fog_there_is_nothing_to_compare(renderer):
    for weather in (WEATHER, replace(WEATHER, fog=Fog(60, height=0))):
        with pytest.raises(SceneError, match="no fog"):
            exposed_volpath(renderer, GREY, orbit(), weather, samples=1, seed=0)


@pytest.mark.parametrize(("height", "sun"), [(60.0, "direction"), (0.5, "disc")])
def test_thin_fog_is_exposed_as_our_own_renderer_does(renderer, height, sun):
    """So thin that the fog's model hardly matters, from inside of the layer and from above it."""
    weather, view = replace(WEATHER, fog=Fog(20_000, height)), orbit(width=12, height=12)
    demand = Demand(forced={"sun": sun, "samples": 64})
    with torch.no_grad():
        ours = renderer.render(GREY, [view], weather, seed=1, demand=demand)
    theirs = exposed_volpath(renderer, GREY, view, weather, samples=256, seed=2, demand=demand)
    where = torch.from_numpy(renderer.vehicle_mask([view])[0] == 1)
    a, b = (float(image[0, :, where].mean()) for image in (ours, theirs))
    assert a == pytest.approx(b, rel=0.02)


def test_prbvolpath_sees_the_fog_around_its_camera(renderer):
    """Mean radiance is that of ``volpath``; its derivative is the finite difference of pictures."""
    light, fog = make_light(WEATHER, renderer.ground_albedo), Fog(60, 30)
    view = orbit(width=8, height=8)
    tracer = PrbVolpath(renderer.geometry, light, fog, view)
    where = renderer.vehicle_mask([view])[0] == 1
    adjoint = np.repeat(where[..., None] / where.sum() / 3, 3, axis=-1)

    def mean_and_error(values: list[float]) -> tuple[float, float]:
        return float(np.mean(values)), float(np.std(values, ddof=1) / np.sqrt(len(values)))

    def means(level: float) -> tuple[list[float], list[float]]:
        renderer.geometry.bind(mi.TensorXf(np.full((8, 8, 3), level, dtype=np.float32)))
        found = [(adjoint * tracer.picture(512, seed)).sum() for seed in range(6)]
        cameras = Cameras([renderer.geometry.local(view)])
        scene, options = renderer.geometry.scene, {"samples": 512}
        theirs = [volpath_picture(scene, light, fog, cameras, seed=s, **options) for s in range(6)]
        return found, [float((adjoint * picture[0]).sum()) for picture in theirs]

    bright, expected = means(0.8)
    dark, _ = means(0.2)
    (a, a_error), (b, b_error) = mean_and_error(bright), mean_and_error(expected)
    assert a == pytest.approx(b, abs=4 * np.hypot(a_error, b_error))
    # The same seeds on both sides: their noise cancels in the difference.
    slope, slope_error = mean_and_error([(x - y) / 0.6 for x, y in zip(bright, dark, strict=True)])
    middle = np.full((8, 8, 3), 0.5)
    gradients = [tracer.gradient(middle, adjoint, 512, 50 + seed).sum() for seed in range(6)]
    found, error = mean_and_error(gradients)
    # Interreflection bends the picture's dependence on the albedo by a few per cent.
    assert found == pytest.approx(slope, abs=4 * np.hypot(error, slope_error) + 0.05 * slope)
