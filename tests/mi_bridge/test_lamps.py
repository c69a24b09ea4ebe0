"""Lamps: closed forms, Mitsuba's own path tracer, and the gradient of what they light."""

from __future__ import annotations

from dataclasses import replace
from unittest import mock

import numpy as np
import pytest
import torch

from cnca.core.photometry import CANDELAS
from cnca.mi_bridge import bridge, integrator
from cnca.mi_bridge.backgrounds import KeptBackgrounds
from cnca.mi_bridge.lamp_shapes import lamp_shapes
from cnca.mi_bridge.lamps import Lamps
from cnca.mi_bridge.light import SKY_COLUMNS, SKY_ROWS, Light
from cnca.mi_bridge.rays import Cameras
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.mi_bridge.sky import Sky
from cnca.mi_bridge.surroundings import Surroundings
from cnca.mi_bridge.variant import mi
from cnca.mi_bridge.volpath import mitsuba_picture
from cnca.scene.cameras import View
from cnca.scene.weather import Weather
from cnca.world.model import Lamp, Surface, World
from tests.mi_bridge.conftest import orbit
from tests.mi_bridge.test_world import ASPHALT, GREY, ROAD, level, quad
from tests.mi_bridge.tracing import diffuse, picture

NIGHT = Weather(sun_altitude=-30)
DARK = Sky(Light(np.array([0.0, 0.0, 1.0]), np.zeros(3), np.zeros((SKY_ROWS, SKY_COLUMNS, 3))))
OVERHEAD = Lamp((0.0, 0.0, 4.0), (0.0, 0.0, -1.0), (3.0, 2.0, 1.0), 0.2)
FLOOD = Lamp((5.0, 4.0, 3.0), (-0.8, -0.6, 0.0), (0.5, 0.5, 0.5), 1.0)
BEAM = Lamp((9.0, 0.5, 0.7), (-1.0, 0.0, 0.0), (20.0, 18.0, 16.0), 0.1, (4.0, 25.0))


def lit_scene(*lamps: Lamp, **shapes) -> tuple[mi.Scene, Surroundings]:
    squares, emitters = lamp_shapes(lamps)
    beams = [emitter for emitter in emitters if emitter.get_shape() is None]
    more = {f"lamp_{i}": lamp for i, lamp in enumerate((*squares, *beams))}
    scene = mi.load_dict({"type": "scene", **shapes, **more})
    return scene, Surroundings(DARK, None, lamps=Lamps(scene, emitters, 1.0))


def matt_plane(reflectance: float) -> dict:
    wide = mi.ScalarTransform4f().scale([100, 100, 1])
    return {"type": "disk", "to_world": wide, "bsdf": diffuse(reflectance)}


def down_at(x: float) -> View:
    """A narrow look at the ground from beside the lamp's beam."""
    return View("down", (x, -3.0, 1.5), (x, 0.0, 0.0), (0.0, 0.0, 1.0), 1.0, 4, 4)


@pytest.mark.parametrize("x", [0.0, 2.0, 5.0])
def test_a_small_lamp_lights_the_ground_by_lambert_and_the_distance(x):
    """E = I cos θ · cos θ / r², the first cosine the lamp's, the second the ground's."""
    scene, around = lit_scene(OVERHEAD, plane=matt_plane(0.4))
    found = picture(scene, around, [down_at(x)], samples=64, bounces=1).mean(axis=(0, 1, 2))
    r2 = x**2 + 16.0
    expected = 0.4 / np.pi * np.array(OVERHEAD.intensity) * 16.0 / r2 / r2
    np.testing.assert_allclose(found, expected, rtol=0.02)


def test_a_beam_is_full_in_its_middle_and_ends_at_its_edge():
    scene, around = lit_scene(
        replace(OVERHEAD, beam=(5.0, 20.0)),
        replace(BEAM, position=(90.0, 90.0, 1.0)),
        plane=matt_plane(0.4),
    )
    within, beyond = (
        picture(scene, around, [down_at(x)], samples=1024, bounces=1).mean(axis=(0, 1, 2))
        for x in (0.0, 4.0 * np.tan(np.radians(21.0)))
    )
    expected = 0.4 / np.pi * np.array(OVERHEAD.intensity) / (4.0 - 0.03) ** 2
    np.testing.assert_allclose(within, expected, rtol=0.03)  # with the glass's stray light
    assert (beyond < 0.02 * within).all()


def test_lamps_agree_with_mitsubas_path():
    """Matt, glossy and mirroring things under two shining squares and a beam: z-scores of chance.

    Mitsuba draws each lamp alike and we by their light, so only the noise may differ.
    """
    glossy = {"type": "twosided", "bsdf": {"type": "roughconductor", "alpha": 0.15}}
    ball = {"type": "sphere", "center": [0, 0, 1], "radius": 1.0, "bsdf": glossy}
    scene, around = lit_scene(OVERHEAD, FLOOD, BEAM, plane=matt_plane(0.4), ball=ball)
    view, runs = orbit(35, 20, 7, width=12, height=12), range(6)
    path = {"type": "path", "max_depth": 4, "rr_depth": 100, "hide_emitters": False}
    cameras = Cameras([view])
    ours = [picture(scene, around, [view], samples=256, bounces=3, seed=s)[0] for s in runs]
    theirs = [mitsuba_picture(scene, path, cameras, samples=512, seed=50 + s)[0] for s in runs]
    difference = np.mean(ours, axis=0) - np.mean(theirs, axis=0)
    variance = np.var(ours, axis=0, ddof=1) + np.var(theirs, axis=0, ddof=1)
    z = difference / np.sqrt(variance / len(runs) + 1e-12)
    assert np.abs(z.mean()) < 0.4
    assert z.std() < 1.7
    means = [np.mean([run.mean() for run in found]) for found in (ours, theirs)]
    assert means[0] == pytest.approx(means[1], rel=0.02)


def lamplit(spot=None, **more) -> World:
    """A road between a lamp over it, a car's beam, and a wall that hides a third lamp."""
    wall = quad("wall", "asphalt", [[-9, 5, 0], [9, 5, 0], [9, 5, 6], [-9, 5, 6]])
    scale = 2000 / CANDELAS
    lamps = tuple(
        replace(lamp, intensity=tuple(scale * c for c in lamp.intensity))
        for lamp in (replace(OVERHEAD, position=(1.0, -2.0, 5.0)), BEAM)
    )
    hidden = replace(lamps[0], position=(0.0, 8.0, 3.0))
    return World("night", (ROAD, wall), {"asphalt": ASPHALT}, lamps=(*lamps, hidden), **more)


@pytest.fixture(scope="module")
def loop(vehicle):
    return KeptBackgrounds(
        MitsubaRenderer(vehicle, texture_size=8, samples=256, bounces=2, worlds=lamplit), GREY
    )


VIEW = orbit(azimuth=-40, elevation=15, distance=9, width=24, height=24)


def test_the_gradient_of_lamplit_paint_is_that_of_differences(loop):
    """The picture is a polynomial of second degree in the texture: differences are exact."""
    renderer, step = loop.renderer, 0.1 * torch.rand(3, 8, 8)
    cameras = {"weather": NIGHT, "seed": 5}
    few = orbit(azimuth=-40, elevation=15, distance=9, width=16, height=16)
    with mock.patch.object(bridge, "BACKWARD_SEED", 0):
        albedo = GREY.clone().requires_grad_()
        renderer.render(albedo, [few], **cameras).mean().backward()
    with torch.no_grad():
        at = [renderer.render(GREY + k * step, [few], **cameras).double().mean() for k in range(3)]
    expected = float(-1.5 * at[0] + 2 * at[1] - 0.5 * at[2])
    assert expected > 0
    assert float((albedo.grad * step).sum()) == pytest.approx(expected, rel=0.01)


def test_the_kept_lamps_of_a_world_are_those_of_its_geometry(loop):
    with torch.no_grad():
        kept = loop.render(GREY, [VIEW], NIGHT, seed=1)[0]
        traced = loop.renderer.render(GREY, [VIEW], NIGHT, seed=2)[0]
    covered = torch.from_numpy(loop.renderer.vehicle_mask([VIEW])[0] > 0)
    kept, traced = kept[:, covered], traced[:, covered]
    assert (kept - traced).mean().abs() < 0.04 * traced.mean()
    gradients = []
    for render in (loop.render, loop.renderer.render):
        albedo = GREY.clone().requires_grad_()
        render(albedo, [VIEW], NIGHT, seed=3).sum().backward()
        gradients.append(albedo.grad.flatten())
    assert torch.nn.functional.cosine_similarity(*gradients, dim=0) > 0.99


@pytest.mark.parametrize(
    ("weather", "lit"),
    [
        (NIGHT, True),
        (replace(NIGHT, lamps="off"), False),
        (Weather(), False),
        (Weather(lamps="on"), True),
    ],
)
def test_lamps_that_are_off_leave_no_code(loop, monkeypatch, weather, lit):
    calls, original = [], integrator.lamplight
    monkeypatch.setattr(integrator, "lamplight", lambda *given: calls.append(1) or original(*given))
    few = orbit(azimuth=-40, elevation=15, distance=9, width=4, height=4)
    loop.renderer.render(GREY, [few], weather, seed=0)
    assert bool(calls) == lit


def test_a_window_that_glows_is_a_lamp_where_there_is_no_other(vehicle):
    glow = Surface(base_color=(0.0, 0.0, 0.0), emission=(1e-3, 5e-4, 1e-4))
    ceiling = level("ceiling", "glass", 3.0, 6.0)
    ceiling = replace(ceiling, faces=ceiling.faces[:, ::-1], normals=-ceiling.normals)
    world = World("hall", (ROAD, ceiling), {"asphalt": ASPHALT, "glass": glow})
    renderer = MitsubaRenderer(vehicle, texture_size=8, samples=64, worlds=lambda spot: world)
    with torch.no_grad():
        dark, lit = (
            renderer.render(GREY, [VIEW], w, seed=0)[0]
            for w in (replace(NIGHT, lamps="off"), NIGHT)
        )
    covered = torch.from_numpy(renderer.vehicle_mask([VIEW])[0] == 1)
    red, _, blue = lit[:, covered].mean(dim=1)
    assert red > 3 * blue
    assert lit[:, covered].mean() > 2 * dark[:, covered].mean()
