"""A world around the vehicle: its shadow, its colors, and what it hides."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from cnca.core.color import srgb_to_linear
from cnca.core.errors import SceneError
from cnca.effects.plan import Demand
from cnca.mi_bridge.backgrounds import KeptBackgrounds
from cnca.mi_bridge.lookups import LookupRenderer
from cnca.mi_bridge.raster import PlainShading
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.mi_bridge.shading_cache import TracedShading
from cnca.mi_bridge.variant import dr, mi
from cnca.mi_bridge.world_shapes import surface_bsdf
from cnca.scene.cameras import Spot
from cnca.scene.weather import Weather
from cnca.world.model import Piece, Surface, World
from tests.mi_bridge.conftest import orbit

GREY = torch.full((3, 8, 8), 0.4)
NOON = Weather(sun_altitude=90, sky_scale=0)


def quad(name, surface, corners) -> Piece:
    corners = np.array(corners, float)
    normal = np.cross(corners[1] - corners[0], corners[3] - corners[0])
    normals = np.tile(normal / np.linalg.norm(normal), (4, 1))
    uvs = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    return Piece(name, surface, corners, np.array([[0, 1, 2], [0, 2, 3]]), normals, uvs)


def level(name, surface, half, z, x=0.0) -> Piece:
    corners = [[x - half, -half, z], [x + half, -half, z], [x + half, half, z], [x - half, half, z]]
    return quad(name, surface, corners)


ROAD = level("road", "asphalt", 500.0, 0.0)
ASPHALT = Surface(base_color=(0.15, 0.15, 0.15), roughness=1.0, specular=0.0)


def street(*pieces, **surfaces) -> World:
    return World("test", (ROAD, *pieces), {"asphalt": ASPHALT, **surfaces})


SLATS = [
    quad(f"slat {y}", "brick", [[4, y, 0], [4, y + 0.1, 0], [4, y + 0.1, 1.5], [4, y, 1.5]])
    for y in np.arange(-1.2, 1.2, 0.3)
]
"""A fence in front of the vehicle."""


def rendered(vehicle, *pieces, weather=NOON, view=None, samples=64, **surfaces):
    world = street(*pieces, **surfaces)
    renderer = MitsubaRenderer(vehicle, texture_size=8, samples=samples, worlds=lambda spot: world)
    renderer.worlds.white = lambda spot, atmosphere: 1.0  # exposed alike, whatever shades
    view = view or orbit(width=32, height=32)
    with torch.no_grad():
        return renderer, renderer.render(GREY, [view], weather, seed=0)[0].numpy()


def test_a_world_out_of_sight_changes_no_pixel(vehicle):
    view = orbit(width=16, height=16)
    far = World("far", (level("lid", "asphalt", 1.0, -50.0),), {"asphalt": ASPHALT}, ground=True)
    pictures = []
    for worlds in (None, lambda spot: far):
        renderer = MitsubaRenderer(vehicle, texture_size=8, samples=16, worlds=worlds)
        with torch.no_grad():
            pictures.append(renderer.render(GREY, [view], Weather(), seed=0))
    plane, world = pictures
    ratio = plane.mean() / world.mean()
    assert ratio == pytest.approx(1, abs=0.02)  # the meter's noise
    torch.testing.assert_close(world * ratio, plane)


def test_a_roof_keeps_the_sun_off(vehicle):
    roof = level("roof", "asphalt", 500.0, 10.0)
    renderer, dark = rendered(vehicle, roof)
    covered = renderer.vehicle_mask([orbit(width=32, height=32)])[0] == 1
    _, lit = rendered(vehicle)
    assert lit[:, covered].mean() > 0.05
    assert dark[:, covered].mean() < 2e-3 * lit[:, covered].mean()  # light from beyond the roof


def test_leaves_let_as_much_sun_pass_as_they_have_holes(vehicle):
    half = Surface(opacity=np.full((1, 1), 64, np.uint8), base_color=(0.0, 0.0, 0.0), specular=0.0)
    renderer, shaded = rendered(vehicle, level("leaves", "leaf", 40.0, 10.0), leaf=half)
    covered = renderer.vehicle_mask([orbit(width=32, height=32)])[0] == 1
    _, lit = rendered(vehicle)
    ratio = shaded[:, covered].mean() / lit[:, covered].mean()
    assert ratio == pytest.approx(1 - 64 / 255, rel=0.02)


def test_the_mask_is_what_can_be_seen(vehicle):
    view = orbit(azimuth=0, elevation=5, distance=12, width=64, height=64)
    free, _ = rendered(vehicle)
    wall = quad("wall", "asphalt", [[4, 0, 0], [4, 9, 0], [4, 9, 9], [4, 0, 9]])
    hidden, _ = rendered(vehicle, wall)
    whole, part = free.vehicle_mask([view])[0], hidden.vehicle_mask([view])[0]
    assert part.sum() == pytest.approx(whole.sum() / 2, rel=0.05)
    left, _, right, _ = hidden.vehicle_boxes([view])[0].tolist()
    assert {left, right} & set(free.vehicle_boxes([view])[0].tolist()[::2])
    assert hidden.visible_shares([view])[0] == pytest.approx(0.5, abs=0.03)


def test_a_vehicle_that_is_hidden_is_an_error(vehicle):
    view = orbit(azimuth=0, elevation=5, distance=12)
    wall = quad("wall", "asphalt", [[4, -9, 0], [4, 9, 0], [4, 9, 9], [4, -9, 9]])
    renderer, _ = rendered(vehicle, wall)
    with pytest.raises(SceneError, match="does not see the vehicle"):
        renderer.vehicle_boxes([view])


def test_pictures_of_surfaces_are_srgb_and_their_factor_is_linear():
    texture = np.array([[[0, 50, 200]]], np.uint8).repeat(2, 0).repeat(2, 1)
    bsdf = surface_bsdf(Surface(base_color=(1.0, 0.5, 1.0), texture=texture))
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.wi = mi.Vector3f(0, 0, 1)
    albedo = np.array(bsdf.eval_diffuse_reflectance(si))[:, 0]
    linear = srgb_to_linear(torch.from_numpy(texture[0, 0] / 255)).numpy()
    np.testing.assert_allclose(albedo, linear * [1, 0.5, 1], rtol=2e-3)


def canyon(spot) -> World:
    """A wall of another color on one side, a low roof that half shades the vehicle, a post."""
    wall = quad("wall", "brick", [[-30, 4, 0], [30, 4, 0], [30, 4, 8], [-30, 4, 8]])
    roof = quad("roof", "asphalt", [[0, -9, 4], [9, -9, 4], [9, 9, 4], [0, 9, 4]])
    post = quad("post", "brick", [[3.0, -1.5, 0], [3.4, -1.5, 0], [3.4, -1.5, 3], [3.0, -1.5, 3]])
    brick = Surface(base_color=(0.6, 0.2, 0.1), roughness=1.0, specular=0.0)
    return street(wall, roof, post, brick=brick)


@pytest.fixture(scope="module")
def loop(vehicle):
    return KeptBackgrounds(
        MitsubaRenderer(vehicle, texture_size=8, samples=256, bounces=3, worlds=canyon), GREY
    )


VIEW = orbit(azimuth=-40, elevation=15, distance=9, width=24, height=24)


@pytest.mark.parametrize("weather", [Weather(sun_azimuth=-60), Weather(sky_scale=0)])
def test_the_kept_light_of_a_world_is_that_of_its_geometry(loop, weather):
    with torch.no_grad():
        kept = loop.render(GREY, [VIEW], weather, seed=1)[0]
        traced = loop.renderer.render(GREY, [VIEW], weather, seed=2)[0]
    background = loop.background(VIEW, weather)
    covered = torch.zeros(VIEW.height * VIEW.width, dtype=torch.bool)
    covered = covered.index_fill(0, torch.from_numpy(background.pixels), True).reshape(24, 24)
    assert torch.equal(kept[:, ~covered], background.image[:, ~covered])
    kept, traced = kept[:, covered], traced[:, covered]
    assert (kept - traced).mean().abs() < 0.03 * traced.mean()
    error = ((kept - traced).square() / (traced.square() + 0.01)).mean().sqrt()
    assert error < 0.1  # as in cnca.effects.prices, noise included


def test_what_hides_the_vehicle_does_so_once_where_geometry_is_traced(vehicle):
    renderer = MitsubaRenderer(
        vehicle,
        texture_size=8,
        samples=256,
        bounces=2,
        worlds=lambda spot: street(*SLATS, brick=Surface(base_color=(0.6, 0.2, 0.1))),
        demand=Demand(forced={"surroundings": "geometry"}),
    )
    behind, loop = orbit(0, 8, 9, width=16, height=16), KeptBackgrounds(renderer, GREY)
    with torch.no_grad():
        kept = loop.render(GREY, [behind], NOON, seed=1)[0]
        traced = renderer.render(GREY, [behind], NOON, seed=2, demand=Demand())[0]
    background = loop.background(behind, NOON)
    partly = background.pixels[(background.shares > 0.2) & (background.shares < 0.8)]
    assert len(partly) > 10
    assert kept.flatten(1)[:, partly].mean() == pytest.approx(
        traced.flatten(1)[:, partly].mean().item(), rel=0.03
    )


def test_the_gradient_through_the_kept_light_is_that_of_the_geometry(loop):
    gradients = []
    for render in (loop.render, loop.renderer.render):
        albedo = GREY.clone().requires_grad_()
        render(albedo, [VIEW], Weather(sun_azimuth=-60), seed=3).sum().backward()
        gradients.append(albedo.grad.flatten())
    assert torch.nn.functional.cosine_similarity(*gradients, dim=0) > 0.99


@pytest.mark.parametrize(("shading", "close"), [(PlainShading, 0.35), (TracedShading, 0.05)])
def test_look_ups_keep_the_light_of_a_world_too(loop, shading, close):
    weather = Weather(sun_azimuth=-60)
    more = {"samples": 256} if shading is TracedShading else {}
    with torch.no_grad():
        picture = LookupRenderer(loop, shading(loop, **more)).render(GREY, [VIEW], weather, seed=1)
        traced = loop.renderer.render(GREY, [VIEW], weather, seed=2)
    covered = torch.from_numpy(loop.renderer.vehicle_mask([VIEW])[0] > 0)
    means = [p[0][:, covered].mean().item() for p in (picture, traced)]
    assert means[0] == pytest.approx(means[1], rel=close)


def test_views_of_two_places_are_not_rendered_together(loop):
    views = [VIEW, replace(VIEW, spot=Spot(place=0.5))]
    with pytest.raises(SceneError, match="one place in the world, got 2"):
        loop.renderer.render(GREY, views, Weather(), seed=0)
