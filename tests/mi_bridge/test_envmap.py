"""A measured environment against Mitsuba's ``envmap``, ``path`` and closed forms."""

from __future__ import annotations

from dataclasses import replace
from unittest import mock

import numpy as np
import pytest
import torch

from cnca.core.images import write_exr
from cnca.effects.effect import Model
from cnca.effects.plan import Demand
from cnca.mi_bridge import bridge
from cnca.mi_bridge.envmap import DirectionTable, EnvironmentMap, TurnedMap, level_irradiance
from cnca.mi_bridge.rays import Cameras
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.mi_bridge.variant import dr, mi
from cnca.mi_bridge.volpath import lit_by_mitsuba, mitsuba_picture
from cnca.scene.environment import read_environment, sky_directions, split_sun
from cnca.scene.weather import Fog, SkyMap, Weather
from tests.mi_bridge.conftest import orbit

ROWS, COLUMNS = 128, 256
GREY = torch.full((3, 8, 8), 0.5)
HEIGHT = 2.0


def blob(azimuth: float, altitude: float, radius: float, radiance: float) -> np.ndarray:
    h, a = np.radians([altitude, azimuth])
    d = np.array([np.cos(h) * np.cos(a), np.cos(h) * np.sin(a), np.sin(h)])
    apart = np.degrees(np.arccos((sky_directions(ROWS, COLUMNS) @ d).clip(-1, 1)))
    return radiance * np.exp(-((apart / radius) ** 2))[..., None] * [1.0, 0.9, 0.6]


def smooth() -> np.ndarray:
    """A sky that is brighter on one side, above ground with a pattern."""
    d = sky_directions(ROWS, COLUMNS)
    above = (1 + 0.8 * d[..., :1] + 0.5 * d[..., 2:]) * [0.5, 0.7, 1.0]
    below = (0.25 + 0.1 * np.sin(5 * np.arctan2(d[..., 1:2], d[..., :1]))) * [1.0, 0.8, 0.6]
    return np.where(d[..., 2:] > 0, above, below)


def weather_of(folder, radiance: np.ndarray, **more) -> Weather:
    """The map's weather; ``radiance`` is in our axes."""
    picture = np.roll(radiance, radiance.shape[1] // 2, axis=1)[:, ::-1]
    path = folder / f"{abs(hash(radiance.tobytes()))}.exr"
    write_exr(path, {"": np.ascontiguousarray(picture, np.float32)})
    place = SkyMap(str(path), **({"height": HEIGHT} | more))
    found = read_environment(place)
    return Weather(
        found.sun_altitude,
        found.sun_azimuth + place.rotation,
        sun_scale=float(found.has_sun),
        sky_map=place,
    )


@pytest.fixture(scope="module")
def sunny(tmp_path_factory) -> Weather:
    return weather_of(tmp_path_factory.mktemp("sky"), smooth() + blob(130, 40, 1.0, 3e3))


@pytest.fixture(scope="module")
def lamps(tmp_path_factory) -> Weather:
    lights = sum(blob(a, 30, 1.2, 4e2) for a in (20, 140, 260))
    return weather_of(tmp_path_factory.mktemp("sky"), 0.1 * smooth() + lights)


def demand(samples: int, **forced: Model) -> Demand:
    return Demand(forced={"samples": samples, "interreflection": 4, **forced})


def test_a_map_is_looked_up_as_it_was_read(tmp_path):
    radiance = np.float32(np.random.default_rng(0).uniform(0, 1, (16, 32, 3)))
    turned = TurnedMap(split_sun(radiance), 2.0, SkyMap("", rotation=360 / 32 * 5))
    d = sky_directions(16, 32).reshape(-1, 3)
    found = EnvironmentMap(turned).radiance(mi.Vector3f(*np.float32(d.T)), mi.Bool(True))
    expected = 2 * np.roll(radiance, 5, axis=1).reshape(-1, 3)
    np.testing.assert_allclose(np.array(found).T, expected, atol=1e-3)


def test_directions_are_drawn_as_often_as_their_density_says():
    weights = np.random.default_rng(1).uniform(0, 1, (8, 16)) ** 3
    table = DirectionTable(weights, dr.opaque(mi.Float, 0.7))
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(0, 1 << 20)
    d, density = table.sample(sampler.next_2d(), mi.Bool(True))
    again = np.array(table.density(d, mi.Bool(True)))
    agree = np.isclose(again, np.array(density), rtol=1e-3)
    assert agree.mean() > 0.9999, "all but some on the border of two texels"
    phi = (np.arctan2(np.array(d.y), np.array(d.x)) - 0.7) % (2 * np.pi)
    row = (np.arccos(np.array(d.z)) / np.pi * 8).astype(int)
    drawn = np.zeros((8, 16))
    np.add.at(drawn, (row, (phi / (2 * np.pi) * 16).astype(int) % 16), 1)
    expected = weights.copy()
    expected[4:] = 0
    np.testing.assert_allclose(drawn / 2**20, expected / expected.sum(), atol=1e-3)
    assert float(dr.mean(1 / density)[0]) == pytest.approx(2 * np.pi, rel=0.02)


def open_ground(view, weather: Weather) -> np.ndarray:
    """What the map shows at the pixels' centres of a camera that looks at level ground."""
    ray, _ = Cameras([view]).rays(1)
    o, d = np.array(ray.o).T, np.array(ray.d).T
    p = o - d * (o[:, 2:] / d[:, 2:])
    seen = p - [0, 0, HEIGHT]
    seen /= np.linalg.norm(seen, axis=1, keepdims=True)
    assert weather.sky_map is not None
    turned = TurnedMap(read_environment(weather.sky_map), 1.0, weather.sky_map)
    found = EnvironmentMap(turned).radiance(mi.Vector3f(*np.float32(seen.T)), mi.Bool(True))
    return np.array(found).T


def test_ground_on_which_nothing_stands_is_as_in_the_picture_and_has_no_noise(renderer, sunny):
    """Beside the vehicle, a little darker by its shadow and brighter by its light."""
    view = orbit(130, 40, 9, width=32, height=32, fov=20, target=(0.0, 0.0, 0.0))
    view = replace(view, origin=(-6.0, 9.0, 3.0), target=(-9.0, 12.0, 0.0))
    images = [renderer.render(GREY, [view], sunny, seed=s, demand=demand(16))[0] for s in range(2)]
    ratio = images[0].permute(1, 2, 0).reshape(-1, 3).numpy() / open_ground(view, sunny)
    exposure = np.median(ratio)
    np.testing.assert_allclose(np.median(ratio, axis=0), exposure, rtol=5e-3)
    np.testing.assert_allclose(ratio, exposure, rtol=0.05)
    assert float((images[0] - images[1]).abs().mean() / images[0].mean()) < 0.005


def as_mitsuba_has_it(renderer: MitsubaRenderer, weather: Weather) -> tuple[mi.Scene, float]:
    """The vehicle on a picture of the ground, under Mitsuba's emitters; and our exposure."""
    chosen = renderer.plan(GREY, [orbit()], weather)
    shot = renderer.shots(chosen, [orbit()], None, seed=0)[0]
    shot.geometry.bind(mi.TensorXf(np.full((8, 8, 3), 0.5, np.float32)))
    light = shot.surroundings.sky.light
    assert light.map is not None
    half, size = 40.0, 1024
    edge = (np.arange(size) + 0.5) / size * 2 * half - half
    x, y = np.meshgrid(edge, edge)  # a bitmap's first row is at v = 0
    seen = np.stack([x, y, np.full_like(x, -HEIGHT)], axis=-1)
    seen /= np.linalg.norm(seen, axis=-1, keepdims=True)
    found = EnvironmentMap(light.map).radiance(
        mi.Vector3f(*np.float32(seen.reshape(-1, 3).T)), mi.Bool(True)
    )
    total = light.map.gain * level_irradiance(light.map.environment)
    total = total + light.sun_irradiance * light.sun_direction[2]
    albedo = (np.pi * np.array(found).T / total).reshape(size, size, 3)
    picture = {
        "type": "bitmap",
        "data": mi.TensorXf(np.float32(albedo)),
        "format": "variant",
        "raw": True,
    }
    ground = {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f().scale([half, half, 1]),
        "bsdf": {"type": "diffuse", "reflectance": picture},
    }
    shapes = [s for s in shot.geometry.scene.shapes() if s.shape_type() != mi.ShapeType.Disk.value]
    parts = {f"part_{i}": shape for i, shape in enumerate(shapes)}
    scene = mi.load_dict({"type": "scene", "ground": ground, **parts})
    return lit_by_mitsuba(scene, light), float(np.array(shot.exposure)[0])


@pytest.mark.parametrize("lit", ["sunny", "lamps"])
def test_vehicle_and_ground_agree_with_path_and_envmap(renderer, lit, request):
    """Mean of each region over independent pictures, within three standard errors and 1 %."""
    weather = request.getfixturevalue(lit)
    view = orbit(150, 25, 9, width=16, height=16, fov=50)
    sky = "map_mis" if lit == "lamps" else "map"
    scene, exposure = as_mitsuba_has_it(renderer, weather)
    cameras = Cameras([view])
    path = {"type": "path", "max_depth": 6, "rr_depth": 100}
    mask = renderer.vehicle_mask([view])[0]
    layers = renderer.layers([view])
    near = (layers.depth[0] < 12) & (mask == 0)
    with torch.no_grad():
        ours = np.stack(
            [
                renderer.render(GREY, [view], weather, seed=s, demand=demand(256, sky=sky))[0]
                .permute(1, 2, 0)
                .numpy()
                for s in range(6)
            ]
        )
    theirs = np.stack(
        [
            exposure * mitsuba_picture(scene, path, cameras, samples=1024, seed=50 + s)[0]
            for s in range(6)
        ]
    )
    for where in (mask == 1, near):
        a, b = (pictures[:, where].mean(axis=1) for pictures in (ours, theirs))
        error = np.hypot(a.std(axis=0, ddof=1), b.std(axis=0, ddof=1)) / np.sqrt(6)
        assert (np.abs(a.mean(axis=0) - b.mean(axis=0)) < 4 * error + 0.01 * b.mean(axis=0)).all()
        assert (error < 0.03 * b.mean(axis=0)).all(), "the comparison can tell"


def noise_and_mean(renderer, weather: Weather, **forced: Model) -> tuple[float, np.ndarray]:
    view = orbit(150, 25, 7)
    mask = torch.from_numpy(renderer.vehicle_mask([view])[0] == 1)
    with torch.no_grad():
        pictures = torch.stack(
            [
                renderer.render(GREY, [view], weather, seed=s, demand=demand(16, **forced))[0][
                    :, mask
                ]
                for s in range(16)
            ]
        )
    mean = pictures.mean(dim=(0, 1, 2))
    return float((pictures.std(dim=0) / pictures.mean()).mean()), mean.numpy()


def test_lamps_are_sampled_where_their_contrast_asks_for_it(renderer, lamps, sunny):
    """And a sky without lamps is not: its kernels are smaller."""
    view = [orbit()]
    assert renderer.plan(GREY, view, lamps)["sky"] == "map_mis"
    assert renderer.plan(GREY, view, sunny)["sky"] == "map"
    found, _ = noise_and_mean(renderer, lamps)
    by_chance, _ = noise_and_mean(renderer, lamps, sky="map")
    assert found < by_chance / 3


@pytest.mark.parametrize("lit", ["sunny", "lamps"])
def test_the_gradient_is_that_of_differences_on_the_same_paths(renderer, lit, request):
    """Exact: with two reflections the mean is a polynomial of at most second degree."""
    weather = request.getfixturevalue(lit)
    view, texture = [orbit()], torch.full((3, 8, 8), 0.4)
    step = 0.2 * torch.rand(3, 8, 8, generator=torch.Generator().manual_seed(0))
    usual = Demand(forced={"samples": 32})

    def mean(albedo: torch.Tensor) -> torch.Tensor:
        return renderer.render(albedo, view, weather, seed=5, demand=usual).double().mean()

    at = [float(mean(texture + k * step)) for k in range(3)]
    learned = texture.clone().requires_grad_()
    with mock.patch.object(bridge, "BACKWARD_SEED", 0):
        mean(learned).backward()
    assert learned.grad is not None
    slope = float((learned.grad.double() * step).sum())
    assert slope == pytest.approx(-1.5 * at[0] + 2 * at[1] - 0.5 * at[2], rel=2e-3)


@pytest.mark.parametrize("lit", ["sunny", "lamps"])
def test_fog_that_is_hardly_there_leaves_the_picture(renderer, lit, request):
    weather = request.getfixturevalue(lit)
    foggy = replace(weather, fog=Fog(1e7, height=30.0))
    (_, clear), (_, thin) = (noise_and_mean(renderer, w) for w in (weather, foggy))
    np.testing.assert_allclose(thin, clear, rtol=0.02)


def test_without_its_sun_a_map_still_shows_its_ground_in_what_light_is_left(renderer, sunny):
    """The reflectance is that of the picture; only the light is less."""
    view = orbit(130, 40, 9, width=8, height=8, fov=10)
    view = replace(view, origin=(-6.0, 9.0, 3.0), target=(-9.0, 12.0, 0.0))
    whole, shaded = (
        renderer.render(GREY, [view], sunny, seed=0, demand=demand(16, **forced))
        for forced in ({}, {"sun": "off"})
    )
    chosen = renderer.plan(GREY, [view], sunny)
    light = renderer.shots(chosen, [view], None, seed=0)[0].surroundings.sky.light
    assert light.map is not None
    sky = light.map.gain * level_irradiance(light.map.environment)
    share = sky / (sky + light.sun_irradiance * light.sun_direction[2])
    ratio = (shaded / whole).mean(dim=(0, 2, 3)).numpy()
    np.testing.assert_allclose(ratio / share, (ratio / share).mean(), rtol=0.01)


@pytest.mark.parametrize("radiance", [0.0, 1.0, 1e6, 1e30])
def test_the_same_light_from_everywhere_is_exposed_to_the_same_picture(
    renderer, tmp_path, radiance
):
    """On grey ground of albedo 1, which reflects what falls on it."""
    weather = weather_of(tmp_path, np.full((2, 4, 3), radiance))
    image = renderer.render(GREY, [orbit()], weather, seed=0, demand=demand(4))
    assert torch.isfinite(image).all()
    assert float(image.mean()) == (0 if radiance == 0 else pytest.approx(0.75, abs=0.2))


def test_a_turned_map_is_a_turned_picture(renderer, tmp_path):
    """A quarter turn of light and camera around a vehicle that is a cube."""
    radiance = smooth() + blob(130, 40, 1.0, 3e3)
    pictures = []
    for rotation in (0.0, 180.0):
        weather = weather_of(tmp_path, radiance, rotation=rotation)
        view = orbit(35 + rotation)
        pictures.append(renderer.render(GREY, [view], weather, seed=0, demand=demand(256)))
    first, second = pictures
    assert float((first - second).abs().mean() / first.mean()) < 0.05
