"""The path tracer against Mitsuba's own ``path`` and ``volpath``."""

from __future__ import annotations

import numpy as np
import pytest

from cnca.mi_bridge.light import Light, make_light
from cnca.mi_bridge.rays import Cameras
from cnca.mi_bridge.variant import mi
from cnca.mi_bridge.volpath import lit_by_mitsuba, mitsuba_picture, volpath_picture
from cnca.scene.cameras import View
from cnca.scene.weather import Fog, Weather
from tests.mi_bridge.conftest import orbit
from tests.mi_bridge.tracing import diffuse, picture, surroundings


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


def test_clear_air_agrees_with_mitsubas_path(renderer, light, painted):
    """The same pictures but for noise: z-scores of all pixels are those of chance."""
    view, runs = orbit(35, 15, 6), range(8)
    around = surroundings(light)
    reference, cameras = lit_by_mitsuba(painted, light), Cameras([view])
    path = {"type": "path", "max_depth": 4, "rr_depth": 100, "hide_emitters": False}
    ours = [picture(painted, around, [view], samples=128, bounces=3, seed=s)[0] for s in runs]
    theirs = [mitsuba_picture(reference, path, cameras, samples=128, seed=50 + s)[0] for s in runs]
    difference = np.mean(ours, axis=0) - np.mean(theirs, axis=0)
    variance = np.var(ours, axis=0, ddof=1) + np.var(theirs, axis=0, ddof=1)
    on_vehicle = renderer.vehicle_mask([view])[0] == 1
    z = (difference / np.sqrt(variance / len(runs) + 1e-12))[on_vehicle]
    assert np.abs(z.mean()) < 0.3
    assert z.std() < 1.6  # Student's t with 14 degrees of freedom, colors correlated
    relative, error = bias([x[on_vehicle] for x in ours], [x[on_vehicle] for x in theirs])
    assert abs(relative) < 0.005 + 3 * error


def fog_bias(
    scene, light, fog: Fog, view, where, *, samples: int, runs: int, ground=0.15, geometry=None
):
    """Bias against ``volpath`` on the pixels ``where``, and its standard error."""
    around = surroundings(light, fog, ground, geometry)
    ours, theirs = [], []
    for seed in range(runs):
        found = picture(scene, around, [view], samples=samples, bounces=4, seed=seed)
        expected = volpath_picture(
            scene, light, fog, Cameras([view]), samples=4 * samples, seed=50 + seed
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


def vehicle_bias(
    renderer, light, fog: Fog, *, size: int, samples: int, runs: int, distance=6.0, azimuth=35.0
):
    """Bias on the pixels that show nothing but the vehicle."""
    view = orbit(azimuth, 15, distance, width=size, height=size)
    where = renderer.vehicle_mask([view])[0] == 1
    geometry = renderer.geometry
    scene = geometry.scene
    return fog_bias(scene, light, fog, view, where, samples=samples, runs=runs, geometry=geometry)


def test_a_vehicle_in_fog_agrees_with_volpath(renderer, light, painted):
    fog = Fog(visibility=100, height=60)
    relative, error = vehicle_bias(renderer, light, fog, size=12, samples=64, runs=6)
    assert error < 0.03
    assert abs(relative) < 0.05 + 3 * error


@pytest.mark.slow
@pytest.mark.parametrize("visibility", [300, 100, 30])
def test_bias_of_a_vehicle_of_many_colors(renderer, light, painted, visibility):
    fog = Fog(visibility, height=60)
    relative, error = vehicle_bias(renderer, light, fog, size=24, samples=256, runs=8)
    print(f"visibility {visibility} m: bias {relative:+.2%} ± {error:.2%}")
    assert error < 0.01
    assert abs(relative) < 0.02 + 3 * error


@pytest.mark.slow
@pytest.mark.parametrize("albedo", [0.02, 0.9])
def test_dark_and_bright_vehicles_keep_their_contrast_in_fog(renderer, light, albedo):
    """Most light that droplets take from the vehicle's image they give back to it.

    With the field of bare ground alone the dark vehicle is 36 % too bright, the bright one 17 % too
    dark.
    """
    renderer.geometry.bind(mi.TensorXf(np.full((8, 8, 3), albedo, dtype=np.float32)))
    fog = Fog(visibility=30, height=60)
    relative, error = vehicle_bias(renderer, light, fog, size=12, samples=256, runs=8)
    print(f"albedo {albedo}: bias {relative:+.2%} ± {error:.2%}")
    assert abs(relative) < 0.05 + 3 * error
