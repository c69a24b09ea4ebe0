"""The path tracer against closed forms and against Mitsuba's own integrators."""

from __future__ import annotations

import numpy as np
import pytest

from cnca.mi_bridge.fog import solve_fog
from cnca.mi_bridge.integrator import FogLayer, Sky, Surroundings, trace
from cnca.mi_bridge.light import SKY_COLUMNS, SKY_ROWS, Light, make_light, sky_directions
from cnca.mi_bridge.rays import Cameras, average_samples
from cnca.mi_bridge.variant import dr, mi
from cnca.scene.cameras import View
from cnca.scene.weather import Fog, Weather
from tests.mi_bridge.conftest import orbit, uniform_light


def surroundings(light: Light, fog: Fog | None = None, ground: float = 0.0) -> Surroundings:
    sky = Sky(light)
    if fog is None:
        return Surroundings(sky, None)
    return Surroundings(sky, FogLayer(fog, solve_fog(fog, light, np.full(3, ground)), sky))


def sampler_for(lanes: int, seed: int) -> mi.Sampler:
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(mi.UInt32(seed), lanes)
    return sampler


def picture(scene, around, views, *, samples=64, bounces=4, seed=0) -> np.ndarray:
    """Linear radiance (views, height, width, 3)."""
    cameras = Cameras(views)
    ray, first = cameras.rays(samples, dr.opaque(mi.UInt32, seed))
    sampler = sampler_for(cameras.lanes(samples), seed)
    radiance = trace(dr.ADMode.Primal, scene, around, sampler, ray, first, bounces=bounces)
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


def path_in_layer(origin: float, slope: float, distance: float) -> float:
    """Length below ``HEIGHT`` of a ray from height ``origin``, by cutting it at the layer's top."""
    inside, leaves_or_enters = origin < HEIGHT, (slope > 0) == (origin < HEIGHT) and slope != 0
    if not leaves_or_enters:
        return distance if inside else 0.0
    cut = min((HEIGHT - origin) / slope, distance)
    return cut if inside else distance - cut


@pytest.mark.parametrize("origin", [0.5, 12.0, 25.0], ids=["low", "inside", "above"])
@pytest.mark.parametrize("slope", [-1.0, -0.3, 0.0, 0.3, 1.0])
@pytest.mark.parametrize("distance", [0.0, 3.0, 60.0, np.inf])
def test_camera_rays_obey_beer_and_lambert(origin, slope, distance):
    fog = Fog(visibility=50.0, height=HEIGHT)
    layer = surroundings(uniform_light(), fog, ground=1.0).fog
    ray = mi.Ray3f(mi.Point3f(0, 0, origin), mi.Vector3f((1 - slope**2) ** 0.5, 0, slope))
    number = mi.Float(np.linspace(0.01, 0.99, 5))
    transmittance, airlight = layer.segment(ray, mi.Float(distance), number, mi.Bool(True))
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
    _, airlight = layer.segment(ray, mi.Float(25.0), share, mi.Bool(True))
    s = 25.0 * share
    source = layer._source_function(1 + s * d.z, d, mi.Bool(True))
    integrand = layer.sigma_t * dr.exp(-layer.sigma_t * s) * source
    expected = 25.0 * np.array(integrand).mean(axis=1)
    np.testing.assert_allclose(np.array(airlight).mean(axis=1), expected, rtol=1e-3)


# ---------------- against Mitsuba's own integrators ----------------


def as_envmap(sky: np.ndarray) -> dict:
    """The same sky as Mitsuba's ``envmap``: y up, φ from −z to +x, here turned to z up."""
    columns = sky.shape[1]
    order = (columns // 4 - 1 - np.arange(columns)) % columns
    turned = mi.ScalarTransform4f(
        np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])
    )
    bitmap = mi.Bitmap(np.ascontiguousarray(sky[:, order], dtype=np.float32))
    return {"type": "envmap", "bitmap": bitmap, "to_world": turned}


def lit_by_mitsuba(scene: mi.Scene, light: Light, **more) -> mi.Scene:
    shapes = {f"shape_{i}": shape for i, shape in enumerate(scene.shapes())}
    sun = {
        "type": "directional",
        "direction": (-light.sun_direction).tolist(),
        "irradiance": {"type": "rgb", "value": light.sun_irradiance.tolist()},
    }
    return mi.load_dict(
        {"type": "scene", "sky": as_envmap(light.sky), "sun": sun, **shapes, **more}
    )


def mitsuba_picture(scene, integrator, views, *, samples, seed=1, medium=None) -> np.ndarray:
    cameras = Cameras(views)
    ray, _ = cameras.rays(samples, dr.opaque(mi.UInt32, seed))
    sampler = sampler_for(cameras.lanes(samples), seed)
    ray = mi.RayDifferential3f(ray)
    radiance, _, _ = mi.load_dict(integrator).sample(scene, sampler, ray, medium)
    return pixels(mi.Color3f(radiance), cameras, samples)


def bias(found: list[np.ndarray], expected: list[np.ndarray]) -> tuple[float, float]:
    """Relative difference of the means over runs of another seed each, and its standard error."""
    ours, theirs = np.array([x.mean() for x in found]), np.array([x.mean() for x in expected])
    error = np.hypot(ours.std(ddof=1), theirs.std(ddof=1)) / np.sqrt(len(found))
    return float(ours.mean() / theirs.mean() - 1), float(error / theirs.mean())


@pytest.fixture(scope="module")
def light(renderer) -> Light:
    return make_light(Weather(sun_altitude=40, sun_azimuth=75), renderer.ground_albedo)


@pytest.fixture(scope="module")
def painted(renderer) -> mi.Scene:
    rng = np.random.default_rng(0)
    renderer.geometry.bind(mi.TensorXf(rng.uniform(0.1, 0.9, (8, 8, 3)).astype(np.float32)))
    return renderer.geometry.scene


def test_the_envmap_of_these_tests_is_the_same_sky(light):
    scene = lit_by_mitsuba(matt_ball(), light)
    d = sky_directions(40, 50).reshape(-1, 3)
    d = mi.Vector3f(*np.float32(d[np.abs(d[:, 2]) > 0.1].T))  # the horizon is a jump
    si = dr.zeros(mi.SurfaceInteraction3f, dr.width(d))
    si.wi = -d
    theirs = np.array(scene.environment().eval(si))
    ours = np.array(Sky(light).radiance(d, mi.Bool(True)))
    np.testing.assert_allclose(ours, theirs, rtol=0.02, atol=0.002 * theirs.max())


def test_clear_air_agrees_with_mitsubas_path(renderer, light, painted):
    """The same pictures but for noise: z-scores of all pixels are those of chance."""
    view, runs = orbit(35, 15, 6), range(8)
    around = surroundings(light)
    reference = lit_by_mitsuba(painted, light)
    path = {"type": "path", "max_depth": 4, "rr_depth": 100, "hide_emitters": False}
    ours = [picture(painted, around, [view], samples=128, bounces=3, seed=s)[0] for s in runs]
    theirs = [mitsuba_picture(reference, path, [view], samples=128, seed=50 + s)[0] for s in runs]
    difference = np.mean(ours, axis=0) - np.mean(theirs, axis=0)
    variance = np.var(ours, axis=0, ddof=1) + np.var(theirs, axis=0, ddof=1)
    on_vehicle = renderer.vehicle_mask([view])[0] == 1
    z = (difference / np.sqrt(variance / len(runs) + 1e-12))[on_vehicle]
    assert np.abs(z.mean()) < 0.3
    assert z.std() < 1.6  # Student's t with 14 degrees of freedom, colours correlated
    relative, error = bias([x[on_vehicle] for x in ours], [x[on_vehicle] for x in theirs])
    assert abs(relative) < 0.005 + 3 * error


def in_fog(scene: mi.Scene, light: Light, fog: Fog) -> tuple[mi.Scene, mi.Medium]:
    """The scene lit by Mitsuba's emitters, in a box of droplets 6 km wide."""
    medium = mi.load_dict(
        {
            "type": "homogeneous",
            "albedo": fog.albedo,
            "sigma_t": fog.extinction,
            "phase": {"type": "hg", "g": fog.asymmetry},
        }
    )
    low, high = -1.0, fog.height
    to_world = mi.ScalarTransform4f().translate([0, 0, (low + high) / 2])
    to_world = to_world @ mi.ScalarTransform4f().scale([3000, 3000, (high - low) / 2])
    layer = {"type": "cube", "to_world": to_world, "bsdf": {"type": "null"}, "interior": medium}
    return lit_by_mitsuba(scene, light, layer=layer), medium


def fog_bias(scene, light, fog: Fog, view, where, *, samples: int, runs: int, ground=0.15):
    """Bias against ``volpath`` on the pixels ``where``, and its standard error."""
    reference, medium = in_fog(scene, light, fog)
    volpath = {"type": "volpath", "max_depth": 128, "rr_depth": 64}
    around = surroundings(light, fog, ground=ground)
    ours, theirs = [], []
    for seed in range(runs):
        found = picture(scene, around, [view], samples=samples, bounces=4, seed=seed)
        expected = mitsuba_picture(
            reference, volpath, [view], samples=4 * samples, seed=50 + seed, medium=medium
        )
        ours.append(found[0][where])
        theirs.append(expected[0][where])
    return bias(ours, theirs)


@pytest.mark.parametrize("target", [(10.0, 0.0, 3.0), (1.0, 0.0, 0.0)], ids=["level", "down"])
def test_fog_over_bare_ground_agrees_with_volpath(light, target):
    """No vehicle: here the plane-parallel field neglects nothing."""
    wide = mi.ScalarTransform4f().scale([2000, 2000, 1])
    ground = {"type": "disk", "to_world": wide, "bsdf": diffuse(0.15)}
    scene = mi.load_dict({"type": "scene", "ground": ground})
    view = View("bare", (0.0, 0.0, 3.0), target, (0.0, 0.0, 1.0), 20.0, 8, 8)
    everywhere = np.full((8, 8), True)
    fog = Fog(visibility=30, height=60)
    relative, error = fog_bias(scene, light, fog, view, everywhere, samples=64, runs=6)
    assert error < 0.03
    assert abs(relative) < 0.02 + 3 * error


def vehicle_bias(renderer, light, fog: Fog, *, size: int, samples: int, runs: int):
    """Bias on the pixels that show nothing but the vehicle, 6 m away."""
    view = orbit(35, 15, 6, width=size, height=size)
    where = renderer.vehicle_mask([view])[0] == 1
    scene = renderer.geometry.scene
    return fog_bias(scene, light, fog, view, where, samples=samples, runs=runs)


def test_a_vehicle_in_fog_agrees_with_volpath(renderer, light, painted):
    fog = Fog(visibility=100, height=60)
    relative, error = vehicle_bias(renderer, light, fog, size=12, samples=64, runs=6)
    assert error < 0.03
    assert abs(relative) < 0.05 + 3 * error


@pytest.mark.slow
@pytest.mark.parametrize(("visibility", "bound"), [(300, 0.04), (100, 0.08), (30, 0.10)])
def test_bias_of_a_vehicle_of_many_colours(renderer, light, painted, visibility, bound):
    fog = Fog(visibility, height=60)
    relative, error = vehicle_bias(renderer, light, fog, size=24, samples=256, runs=8)
    print(f"visibility {visibility} m: bias {relative:+.2%} ± {error:.2%}")
    assert error < 0.01
    assert abs(relative) < bound + 3 * error


@pytest.mark.slow
@pytest.mark.parametrize(("albedo", "low", "high"), [(0.02, 0.0, 0.45), (0.9, -0.25, 0.0)])
def test_light_scattered_forwards_is_what_the_field_neglects(renderer, light, albedo, low, high):
    """It leaves too little contrast: a dark vehicle comes out too bright, a bright one too dark.

    Droplets scatter forwards, so most of the light that they take from the vehicle's image would
    come back from another place of the vehicle; the field gives back the light of bare ground.
    """
    renderer.geometry.bind(mi.TensorXf(np.full((8, 8, 3), albedo, dtype=np.float32)))
    fog = Fog(visibility=30, height=60)
    relative, error = vehicle_bias(renderer, light, fog, size=12, samples=256, runs=8)
    print(f"albedo {albedo}: bias {relative:+.2%} ± {error:.2%}")
    assert low - 3 * error < relative < high + 3 * error
