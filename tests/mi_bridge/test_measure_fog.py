"""The light of fog in a world, by random walks, against its solution over open ground."""

from __future__ import annotations

import numpy as np
import pytest

from cnca.mi_bridge.fog import FogField
from cnca.mi_bridge.geometry import Geometry
from cnca.mi_bridge.measure_fog import _walk, measure_fog, scattered_direction
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.mi_bridge.surroundings import Surroundings
from cnca.mi_bridge.variant import dr, mi
from cnca.scene.cameras import Spot
from cnca.scene.environment import sky_solid_angles
from cnca.scene.weather import Fog, Weather
from cnca.world.model import Surface, World
from tests.mi_bridge.test_world import ASPHALT, level, quad

WEATHER = Weather(sun_altitude=40, fog=Fog(60, height=30.0))


def foggy(vehicle, *pieces) -> tuple[Geometry, Surroundings]:
    """A world of these pieces, and what lights it."""
    surfaces = {"asphalt": ASPHALT, "black": Surface(base_color=(0.0, 0.0, 0.0), specular=0.0)}
    world = World("open", (level("lid", "asphalt", 1.0, -50.0), *pieces), surfaces, ground=True)
    renderer = MitsubaRenderer(vehicle, texture_size=8, worlds=lambda spot: world)
    around = renderer.built.atmosphere(WEATHER, "direction", "map", "field", "off").surroundings
    return renderer.worlds._both(Spot())[1], around


def fields(vehicle, *pieces) -> tuple[FogField, FogField]:
    """Measured, and over open ground."""
    bare, around = foggy(vehicle, *pieces)
    return measure_fog(bare, around, around.fog), around.fog.field


def mean_light(table: np.ndarray) -> float:
    """Over all directions and colors."""
    weights = np.broadcast_to(sky_solid_angles(*table.shape[:2])[..., None], table.shape)
    return float(np.average(table, weights=weights))


def test_over_open_ground_walks_find_what_the_equation_says(vehicle):
    measured, solved = fields(vehicle)
    for name in ("radiance", "source"):
        table, expected = getattr(measured, name), getattr(solved, name)
        light = np.interp(measured.heights, solved.heights, [mean_light(t) for t in expected])
        ratio = np.array([mean_light(t) for t in table]) / light
        assert ratio.mean() == pytest.approx(1, abs=0.02)
        assert ratio == pytest.approx(np.ones(len(ratio)), abs=0.06)  # the noise of 8 levels


def test_between_black_walls_fog_is_darker(vehicle):
    walls = [
        quad(f"wall {y}", "black", [[-99, y, 0], [99, y, 0], [99, y, 12], [-99, y, 12]])
        for y in (-6, 6)
    ]
    measured, solved = fields(vehicle, *walls)
    shares = [mean_light(measured.source[at]) / mean_light(solved.source[at]) for at in (0, -1)]
    assert shares[0] < 0.7  # a hemisphere's worth at most
    assert shares[0] < shares[1] < 1


def test_in_front_of_a_wall_fog_is_darker_most_of_all_towards_it(vehicle):
    wall = quad("wall", "black", [[-99, 13, 0], [99, 13, 0], [99, 13, 15], [-99, 13, 15]])
    bare, around = foggy(vehicle, wall)
    layer = around.fog.among(measure_fog(bare, around, around.fog))
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(3, 1 << 16)
    ratios = []
    for y, towards in ((10, 1), (10, -1), (-10, 1)):
        d = mi.Vector3f(mi.Float(0), towards, dr.zeros(mi.Float, 1 << 16))
        p = mi.Point3f(0, y, 2 + 0 * d.z)
        J, _ = layer._source_function(p, d, mi.Bool(True), 0.0)
        scattered = scattered_direction(d, layer.asymmetry, sampler.next_2d())
        walked = layer.albedo * _walk(bare.scene, around, layer, sampler, p, scattered)
        ratios.append([np.mean(light) for light in (J, walked)])
    found, expected = np.transpose(ratios)
    assert expected[0] < 0.6 * expected[2]
    np.testing.assert_allclose(found, expected, rtol=0.15, atol=0.05 * expected[2])
