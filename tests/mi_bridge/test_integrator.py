"""The path tracer against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cnca.mi_bridge.fog import henyey_greenstein, solve_fog
from cnca.mi_bridge.fog_layer import FogLayer
from cnca.mi_bridge.light import SKY_COLUMNS, SKY_ROWS, Light, make_light
from cnca.mi_bridge.sky import Sky
from cnca.mi_bridge.surroundings import Surroundings
from cnca.mi_bridge.variant import dr, mi
from cnca.scene.cameras import View
from cnca.scene.weather import Fog, Weather
from tests.mi_bridge.conftest import orbit, uniform_light
from tests.mi_bridge.tracing import diffuse, picture, surroundings


def matt_ball(reflectance: float = 1.0) -> mi.Scene:
    ball = {"type": "sphere", "center": [0, 0, 2], "radius": 1.5, "bsdf": diffuse(reflectance)}
    return mi.load_dict({"type": "scene", "ball": ball})


def matt_plane(reflectance: float) -> mi.Scene:
    wide = mi.ScalarTransform4f().scale([100, 100, 1])
    plane = {"type": "disk", "to_world": wide, "bsdf": diffuse(reflectance)}
    return mi.load_dict({"type": "scene", "plane": plane})


@pytest.mark.parametrize("altitude", [90, 60, 30, 5])
def test_a_matt_plane_under_the_sun_obeys_lamberts_law(altitude):
    a = np.radians(altitude)
    sun = np.array([np.cos(a), 0, np.sin(a)])
    light = Light(sun, np.array([3.0, 2.0, 1.0]), np.zeros((SKY_ROWS, SKY_COLUMNS, 3)))
    view = orbit(30, 60, 10, target=(0.0, 0.0, 0.0), fov=20)
    image = picture(matt_plane(0.4), surroundings(light), [view], samples=1)
    expected = 0.4 / np.pi * light.sun_irradiance * np.sin(a)
    np.testing.assert_allclose(image, np.broadcast_to(expected, image.shape), rtol=1e-4)


def test_white_furnace_in_clear_air():
    """A white matt ball in a uniform sky cannot be seen."""
    image = picture(matt_ball(), surroundings(uniform_light()), [orbit()], samples=16)
    np.testing.assert_allclose(image, 1.0, rtol=1e-3)


@pytest.mark.parametrize("fog", [Fog(200, albedo=1), Fog(5, albedo=1), Fog(60, 2.5, albedo=1)])
def test_white_furnace_in_fog(fog):
    """The same in droplets that absorb nothing, also with the ball's top above the layer."""
    around = surroundings(uniform_light(), fog, ground=1.0)
    image = picture(matt_ball(), around, [orbit()], samples=16)
    np.testing.assert_allclose(image, 1.0, rtol=5e-3)


def test_a_grey_ball_in_a_uniform_sky_shows_its_albedo():
    view = orbit(fov=5, target=(0.0, 0.0, 2.0))
    image = picture(matt_ball(0.3), surroundings(uniform_light()), [view], samples=16)
    np.testing.assert_allclose(image, 0.3, rtol=1e-3)


HEIGHT = 20.0


def surface_at(distance: float) -> mi.SurfaceInteraction3f:
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.t = mi.Float(distance)
    return si


def path_in_layer(origin: float, slope: float, distance: float) -> float:
    """Length below ``HEIGHT`` of a ray from height ``origin``, by cutting it at the layer's top."""
    inside, leaves_or_enters = origin < HEIGHT, (slope > 0) == (origin < HEIGHT) and slope != 0
    if not leaves_or_enters:
        return distance if inside else 0.0
    cut = min((HEIGHT - origin) / slope, distance)
    return cut if inside else distance - cut


@pytest.fixture(scope="module")
def furnace_layer() -> FogLayer:
    """Fog in the same light from everywhere, over white ground."""
    fog = Fog(visibility=50.0, height=HEIGHT)
    return surroundings(uniform_light(), fog, ground=1.0).fog


@pytest.mark.parametrize("origin", [0.5, 12.0, 25.0], ids=["low", "inside", "above"])
@pytest.mark.parametrize("slope", [-1.0, -0.3, 0.0, 0.3, 1.0])
@pytest.mark.parametrize("distance", [0.0, 3.0, 60.0, np.inf])
def test_camera_rays_obey_beer_and_lambert(furnace_layer, origin, slope, distance):
    layer, fog = furnace_layer, furnace_layer.fog
    ray = mi.Ray3f(mi.Point3f(0, 0, origin), mi.Vector3f((1 - slope**2) ** 0.5, 0, slope))
    number = mi.Float(np.linspace(0.01, 0.99, 5))
    transmittance, airlight = layer.segment(ray, surface_at(distance), number, mi.Bool(True))
    expected = np.exp(-fog.extinction * path_in_layer(origin, slope, distance))
    np.testing.assert_allclose(transmittance, expected, rtol=1e-4, atol=1e-7)
    # In a furnace with droplets that absorb 1 %, the air gives back a bit less than it takes.
    assert np.isfinite(airlight).all()
    assert (np.array(airlight) <= 1 - expected + 1e-3).all()
    assert (np.array(airlight) >= 0.8 * (1 - expected)).all()


def test_the_suns_light_fades_along_its_slant_path():
    a = np.radians(30)
    light = Light(np.array([np.cos(a), 0, np.sin(a)]), np.ones(3), np.zeros((128, 256, 3)))
    fog = Fog(visibility=50.0, height=HEIGHT)
    layer = surroundings(light, fog).fog
    z = np.array([0.0, 5.0, 19.9, 20.0, 30.0])
    found = np.array(layer.sun_transmittance(mi.Float(z)))
    expected = np.exp(-fog.extinction * np.maximum(HEIGHT - z, 0) / np.sin(a))
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_the_mean_airlight_is_the_integral_of_the_source_function():
    """Sampling distances in proportion to σ_t T(s) is unbiased: compare with even distances."""
    light = make_light(Weather(sun_altitude=40), np.full(3, 0.2))
    fog = Fog(visibility=30.0, height=HEIGHT)
    layer = surroundings(light, fog, ground=0.2).fog
    d = mi.Vector3f(0.8, 0, 0.6)
    ray = mi.Ray3f(mi.Point3f(0, 0, 1), d)
    share = mi.Float((np.arange(4096) + 0.5) / 4096)
    _, airlight = layer.segment(ray, surface_at(25.0), share, mi.Bool(True))
    s = 25.0 * share
    source, _ = layer._source_function(ray(s), d, mi.Bool(True))
    integrand = layer.sigma_t * dr.exp(-layer.sigma_t * s) * source
    expected = 25.0 * np.array(integrand).mean(axis=1)
    np.testing.assert_allclose(np.array(airlight).mean(axis=1), expected, rtol=1e-3)


def test_one_airlight_is_without_noise():
    light = make_light(Weather(sun_altitude=40), np.full(3, 0.2))
    fog = Fog(visibility=30.0, height=HEIGHT)
    field = solve_fog(fog, light, np.full(3, 0.2), "airlight")
    layer = FogLayer(fog, field, Sky(light))
    ray = mi.Ray3f(mi.Point3f(0, 0, 1), mi.Vector3f(0.8, 0, 0.6))
    number = mi.Float(np.linspace(0.01, 0.99, 5))
    T, found = layer.segment(ray, surface_at(25.0), number, mi.Bool(True))
    np.testing.assert_allclose(T, np.exp(-fog.extinction * 25.0), rtol=1e-5)
    expected = (1 - np.array(T)) * np.float32(field.airlight)[:, None]
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_without_a_sky_the_ground_still_reaches_the_horizon():
    """A camera 50 m above a disc of 100 m looks 4 to 54° down, beyond the disc's edge too."""
    light = make_light(Weather(sun_altitude=30, sky_scale=0.0), np.full(3, 0.4))
    around = Surroundings(Sky(light, has_map=False), None)
    view = View("far", (0.0, 0.0, 50.0), (90.0, 0.0, 0.0), (0.0, 0.0, 1.0), 50.0, 8, 8)
    image = picture(matt_plane(0.4), around, [view], samples=4)
    expected = 0.4 / np.pi * light.sun_irradiance * np.sin(np.radians(30))
    np.testing.assert_allclose(image, np.broadcast_to(expected, image.shape), rtol=1e-3)


@pytest.mark.parametrize("asymmetry", [0.0, 0.85, -0.85, 0.9999, -0.9999])
def test_sunlight_is_scattered_by_the_phase_function(asymmetry):
    """J of the sun alone at the layer's top, in the lobe's middle, on its edge and beside it."""
    light = make_light(Weather(sun_altitude=90, sky_scale=0.0), np.zeros(3))
    light = replace(light, sky=np.zeros_like(light.sky))
    fog = Fog(100.0, HEIGHT, albedo=1e-12, asymmetry=asymmetry)  # none scatters twice
    layer = surroundings(light, fog).fog
    angles = np.radians([0.0, 0.003, 0.3, 90.0, 179.997, 180.0])
    d = mi.Vector3f(np.float32(np.sin(angles)), mi.Float(0), np.float32(np.cos(angles)))
    J, _ = layer._source_function(mi.Point3f(0, 0, HEIGHT), d, mi.Bool(True))
    expected = fog.albedo * henyey_greenstein(np.cos(angles), asymmetry)
    np.testing.assert_allclose(np.array(J)[0] / light.sun_irradiance[0], expected, rtol=2e-3)
