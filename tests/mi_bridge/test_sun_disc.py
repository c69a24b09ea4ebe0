"""The sun as a disc: the same light as a direction, and shadows whose edges are soft."""

from __future__ import annotations

import numpy as np
import pytest

from cnca.mi_bridge.integrator import trace
from cnca.mi_bridge.light import SKY_COLUMNS, SKY_ROWS, SUN_HALF_ANGLE, Light
from cnca.mi_bridge.sky import Sky
from cnca.mi_bridge.surroundings import Surroundings
from cnca.mi_bridge.variant import dr, mi
from tests.mi_bridge.tracing import diffuse, sampler_for

ALBEDO, HEIGHT, RAYS = 0.5, 10.0, 20_000


def radiance(scene: mi.Scene, altitude: float, x: np.ndarray) -> np.ndarray:
    """Mean radiance of the ground at each ``x``, seen from straight above at 1 m."""
    a = np.radians(altitude)
    sun = np.array([0.0, np.cos(a), np.sin(a)])
    light = Light(sun, np.ones(3), np.zeros((SKY_ROWS, SKY_COLUMNS, 3)))
    around = Surroundings(Sky(light, sun_disc=True), None)
    origin = mi.Point3f(mi.Float(np.repeat(x, RAYS).astype(np.float32)), 0, 1)
    ray = mi.Ray3f(origin, mi.Vector3f(0, 0, -1))
    lanes = RAYS * len(x)
    first = [mi.Float(0.5) + dr.zeros(mi.Float, lanes) for _ in range(3)]
    sampler = sampler_for(lanes, 1)
    found, _ = trace(scene, around, sampler, ray, first, bounces=1)
    return np.array(found.x).reshape(len(x), RAYS).mean(axis=1)


def plane_with(**shapes) -> mi.Scene:
    wide = mi.ScalarTransform4f().scale([100, 100, 1])
    plane = {"type": "disk", "to_world": wide, "bsdf": diffuse(ALBEDO)}
    return mi.load_dict({"type": "scene", "plane": plane, **shapes})


@pytest.mark.parametrize("altitude", [90, 30, 5])
def test_it_obeys_lamberts_law_as_a_direction_does(altitude):
    found = radiance(plane_with(), altitude, np.array([0.0]))
    expected = ALBEDO / np.pi * np.sin(np.radians(altitude))
    # The cosine's mean over the disc is that of its middle, but for noise of 0.27° at 5°.
    noise = SUN_HALF_ANGLE / np.tan(np.radians(altitude)) / 2 / RAYS**0.5
    assert found[0] == pytest.approx(expected, rel=1e-4 + 4 * noise)


def test_a_straight_edge_casts_the_shadow_of_a_half_covered_disc():
    """Share of a disc beyond a chord at u radii: 1/2 + (u √(1 − u²) + arcsin u) / π."""
    roof = mi.ScalarTransform4f().translate([-50, 0, HEIGHT]).scale([50, 50, 1])
    roof = {"type": "rectangle", "to_world": roof, "bsdf": diffuse(0.0)}
    u = np.array([-1.2, -0.8, -0.3, 0.0, 0.4, 0.9, 1.2])
    found = radiance(plane_with(roof=roof), 90, u * HEIGHT * np.tan(SUN_HALF_ANGLE))
    inside = u.clip(-1, 1)
    share = 0.5 + (inside * np.sqrt(1 - inside**2) + np.arcsin(inside)) / np.pi
    error = 4 * np.sqrt(share * (1 - share) / RAYS) + 1e-3
    assert (np.abs(found / (ALBEDO / np.pi) - share) < error).all()
