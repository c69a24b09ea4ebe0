"""The recorded draws of the live view are what the renderer renders."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from cnca import build
from cnca.core.types import LinearTexture
from cnca.effects.plan import Demand
from cnca.mi_bridge.live import LiveCamera
from cnca.scene.cameras import orbit_view
from cnca.scene.schema import Scene
from cnca.scene.weather import Fog, Weather

SIZE = 24
ONE_RAY = Demand(forced={"gradient": "off", "samples": 1})
DAY = Weather(sun_altitude=40.0)
FOG = replace(DAY, fog=Fog(visibility=60.0))


def view(azimuth=30.0, size=SIZE):
    return orbit_view(azimuth, 12.0, 7.5, fov=45.0, width=size, height=size)


def texture(level):
    return LinearTexture(torch.full((3, 32, 32), level))


@pytest.fixture(scope="module")
def renderer():
    scene = Scene.model_validate({"vehicle": {"texture_size": 32}})
    return build.build_path_tracer(scene, build.build_vehicle(scene))


@pytest.fixture(scope="module")
def camera(renderer):
    return LiveCamera(renderer)


def drawn(camera, albedo, view, weather, *, seed=0, first=0):
    chosen = camera.renderer.plan(albedo, [view], weather, demand=ONE_RAY)
    return camera.draw(chosen, albedo, view, seed=seed, first=first)


def rendered(renderer, albedo, view, weather, seed=0):
    with torch.no_grad():
        images = renderer.render(albedo, [view], weather, seed=seed, demand=ONE_RAY)
    return images[0].permute(1, 2, 0).numpy()


@pytest.mark.parametrize("weather", [DAY, FOG], ids=["clear", "fog"])
def test_what_changes_between_draws_reaches_the_recorded_kernel(renderer, camera, weather):
    """Camera, seed, texture and sun are other ones each time; the first two calls record."""
    for turn, level in enumerate([0.2, 0.2, 0.6, 0.9]):
        albedo, at = texture(level), view(30.0 + 40 * turn)
        now = replace(weather, sun_altitude=30.0 + 10 * turn, sun_azimuth=50.0 * turn)
        expected = rendered(renderer, albedo, at, now, seed=turn)
        assert np.array_equal(drawn(camera, albedo, at, now, seed=turn), expected)


def test_draws_use_one_recording(camera):
    """However numpy's arrays come to lie in memory, which the views between them move."""
    elsewhere = []
    for turn in range(12):
        elsewhere.append(np.zeros(turn + 1, np.float32))
        drawn(camera, texture(0.3), view(30.0 * turn, SIZE + 1), DAY, first=turn)
    recordings = [r for key, r in camera._recordings.items() if key[0] == (SIZE + 1, SIZE + 1)]
    assert [recording.recordings for recording in recordings] == [1]


def test_the_mean_of_the_draws_is_the_picture(renderer, camera):
    """Against one render of the same samples, up to the random numbers after the first bounce."""
    albedo, count = texture(0.4), 64
    draws = [drawn(camera, albedo, view(), DAY, first=first) for first in range(count)]
    demand = Demand(forced={"gradient": "off", "samples": count})
    with torch.no_grad():
        whole = renderer.render(albedo, [view()], DAY, seed=0, demand=demand)
    apart = np.mean(draws, axis=0) - whole[0].permute(1, 2, 0).numpy()
    assert np.sqrt(np.mean(apart**2)) < 0.02


def test_a_draw_that_cannot_be_recorded_is_traced_with_the_light_of_now(renderer, monkeypatch):
    camera, albedo = LiveCamera(renderer), texture(0.5)
    drawn(camera, albedo, view(), DAY)
    (recording,) = camera._recordings.values()

    def fail(*given):
        raise RuntimeError("not recorded")

    monkeypatch.setattr(recording, "_recorded", fail)
    evening = replace(DAY, sun_altitude=10.0)
    for _ in range(3):
        expected = rendered(renderer, albedo, view(), evening)
        assert np.array_equal(drawn(camera, albedo, view(), evening), expected)


@pytest.mark.slow
def test_a_world_by_day_and_with_its_lamps_on():
    scene = Scene.model_validate({"vehicle": {"texture_size": 32}, "world": "builtin:street"})
    renderer = build.build_path_tracer(scene, build.build_vehicle(scene))
    camera = LiveCamera(renderer)
    for weather in (DAY, replace(DAY, sun_altitude=-10.0), DAY):
        for azimuth in (30.0, 120.0):
            expected = rendered(renderer, texture(0.5), view(azimuth), weather)
            assert np.array_equal(drawn(camera, texture(0.5), view(azimuth), weather), expected)


def test_wet_ground_which_cannot_be_recorded():
    wet = {"vehicle": {"texture_size": 32}, "ground": {"wetness": 0.8}}
    scene = Scene.model_validate(wet)
    renderer = build.build_path_tracer(scene, build.build_vehicle(scene))
    camera = LiveCamera(renderer)
    for azimuth in (30.0, 120.0):
        expected = rendered(renderer, texture(0.5), view(azimuth), DAY)
        assert np.array_equal(drawn(camera, texture(0.5), view(azimuth), DAY), expected)


def test_a_measured_sky_turns(tmp_path):
    from cnca.core.images import write_exr

    sky = np.random.default_rng(0).uniform(0.2, 1.0, (16, 32, 3)).astype(np.float32)
    write_exr(tmp_path / "sky.exr", {"": sky})
    for rotation in (0.0, 90.0):
        content = {"vehicle": {"texture_size": 32}, "sky": {"map": "sky.exr", "rotation": rotation}}
        scene = Scene.model_validate({**content, "base": tmp_path})
        if rotation == 0.0:
            renderer = build.build_path_tracer(scene, build.build_vehicle(scene))
            camera = LiveCamera(renderer)
        expected = rendered(renderer, texture(0.5), view(), scene.weather())
        assert np.array_equal(drawn(camera, texture(0.5), view(), scene.weather()), expected)
