"""Wet ground against Lekner and Dorf's formula, Fresnel's, and a mirror's geometry."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from cnca.effects.plan import Demand
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.mi_bridge.variant import dr, mi
from cnca.mi_bridge.wet import CAUGHT, COVER, PUDDLE, WetRoughness, wet_albedo, wet_principled
from cnca.scene.weather import Weather
from tests.mi_bridge.conftest import orbit

GREY = torch.full((3, 8, 8), 0.4)


def hit(up: float) -> mi.SurfaceInteraction3f:
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.n = mi.Normal3f((1 - up**2) ** 0.5, 0, up)
    si.wi = mi.Vector3f(0, 0, 1)
    return si


@pytest.mark.parametrize("dry", [0.05, 0.15, 0.4, 0.9])
def test_wet_ground_is_as_dark_as_light_bounced_in_the_film_leaves_it(dry):
    """The sum over reflections from below, term by term."""
    into, out = 1 - 0.066, 1 - CAUGHT
    expected = sum(into * dry * (CAUGHT * dry) ** k * out for k in range(200))
    assert wet_albedo(np.full(3, dry), 1.0)[0] == pytest.approx(expected, rel=1e-6)
    assert expected < dry
    half, full = wet_albedo(np.full(3, dry), 0.25), wet_albedo(np.full(3, dry), 0.5)
    np.testing.assert_allclose(half, (dry + full) / 2)


def test_the_bsdf_is_that_dark_where_it_looks_up_and_dry_where_not():
    plain = {
        "type": "principled",
        "base_color": {"type": "rgb", "value": 0.2},
        "roughness": 0.9,
        "specular": 0.3,
    }
    bsdf = mi.load_dict(wet_principled(plain, 1.0))
    level, steep = (
        float(np.array(bsdf.eval_diffuse_reflectance(hit(up)))[0, 0]) for up in (1.0, 0.5)
    )
    assert level == pytest.approx(wet_albedo(np.full(3, 0.2), 1.0)[0], rel=1e-4)
    assert steep == pytest.approx(0.2, rel=1e-4)


@pytest.mark.parametrize(("wetness", "share"), [(0.5, 0.0), (0.75, COVER / 2), (1.0, COVER)])
def test_puddles_cover_their_share_of_the_ground(wetness, share):
    rng = np.random.default_rng(0)
    si = dr.zeros(mi.SurfaceInteraction3f, 4096)
    x, y = (mi.Float(np.float32(rng.uniform(-50, 50, 4096))) for _ in range(2))
    si.p, si.n = mi.Point3f(x, y, 0), mi.Normal3f(0, 0, 1)
    roughness = np.array(WetRoughness(0.9, wetness).eval_1(si, mi.Bool(True)))
    assert (roughness < 2 * PUDDLE).mean() == pytest.approx(share, abs=0.03)
    assert roughness.max() < 0.4


@pytest.fixture(scope="module")
def wet(vehicle) -> MitsubaRenderer:
    return MitsubaRenderer(vehicle, texture_size=8, samples=64, wetness=1.0)


def test_a_wet_plane_mirrors_the_car_in_its_color(wet):
    """Red paint at a flat angle: the ground before it turns red, on the dry ground by far less."""
    red = torch.zeros(3, 8, 8)
    red[0] = 0.8
    view = orbit(azimuth=90, elevation=4, distance=14, fov=30, width=48, height=48)
    tints = []
    for model in ("film", "dry"):
        demand = Demand(forced={"wetness": model})
        with torch.no_grad():
            image = wet.render(
                red, [view], Weather(sun_altitude=40, sun_azimuth=90), seed=0, demand=demand
            )[0]
        covered = wet.vehicle_mask([view])[0] > 0
        foot = np.flatnonzero(covered.any(axis=1))[-1]
        columns = covered[foot - 1]
        strip = image[:, foot + 1 : foot + 4, columns]
        tints.append(float(strip[0].mean() / strip[2].mean()))
    assert tints[0] > 1.25 * tints[1]


def test_the_gradient_goes_through_the_film(wet):
    albedo = GREY.clone().requires_grad_()
    wet.render(albedo, [orbit()], Weather(), seed=0).mean().backward()
    assert torch.isfinite(albedo.grad).all()
    assert albedo.grad.abs().sum() > 0
