"""The loop's backends by name, on a scene file."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from cnca import build
from cnca.core.errors import CncaError
from cnca.effects.protocols import PlanningRenderer
from cnca.mi_bridge.backends import BACKENDS, parse_backend
from cnca.scene import controls
from cnca.scene.load_scene import load_scene
from cnca.scene.schema import ImageSection, Scene
from cnca.scene.views import build_views


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("rastr", "did you mean 'raster'"),
        ("raster:8", "only cached is refreshed, such as cached:8"),
        ("cached:0", "such as cached:8"),
        ("cached:", "such as cached:8"),
    ],
)
def test_unknown_backends_are_refused(spec, message):
    with pytest.raises(CncaError, match=message):
        parse_backend(spec)


def test_every_backend_draws_the_scene_and_the_path_tracer_judges_it():
    scene = Scene.model_validate(
        {"vehicle": {"texture_size": 16}, "image": {"width": 24, "height": 24}}
    )
    vehicle = build.build_vehicle(scene)
    paint, view = build.build_paint(scene, vehicle), build_views(scene)[0]
    brightness = {}
    for name in BACKENDS:
        loop = build.build_loop_renderer(scene, vehicle, paint, backend=name, samples=4)
        image = loop.render(paint.apply(), [view], scene.weather(), seed=0)
        assert image.shape == (1, 3, 24, 24)
        brightness[name] = float(image.mean())
        judge = build.build_renderer(scene, vehicle, backend=name)
        assert isinstance(judge, PlanningRenderer)
    assert brightness["cached"] == pytest.approx(brightness["mitsuba"], rel=0.03)
    # Without shadows and gloss, but in the same light.
    assert brightness["raster"] == pytest.approx(brightness["mitsuba"], rel=0.2)
    assert not torch.tensor(list(brightness.values())).isnan().any()


@pytest.mark.parametrize("name", ["builtin:sedan_clear", "builtin:sedan_fog"])
def test_the_shipped_efr_brings_raster_nearer_to_the_path_tracer(name):
    scene = load_scene(Path(name))
    scene = scene.model_copy(update={"image": ImageSection(width=128, height=128)})
    vehicle = build.build_vehicle(scene)
    paint, view = build.build_paint(scene, vehicle), build_views(scene)[0]
    raster = build.build_loop_renderer(scene, vehicle, paint, backend="raster", samples=4)
    residual = build.build_residual(Path("builtin"))
    assert residual is not None
    size, weather = scene.vehicle.texture_size, scene.weather()
    albedo = paint.apply(controls.random_blocks(size, torch.Generator().manual_seed(3)))
    with torch.no_grad():
        drawn = raster.render(albedo, [view], weather, seed=0)
        corrected = residual(drawn, raster.reference([view], weather, seed=0))
        tracer = build.build_renderer(scene, vehicle, samples=64)
        truth = tracer.render(albedo, [view], weather, seed=1)
    car = torch.from_numpy(tracer.vehicle_mask([view])[0] == 1)
    before, after = (float((image - truth)[0, :, car].abs().mean()) for image in (drawn, corrected))
    assert after < before / 2
