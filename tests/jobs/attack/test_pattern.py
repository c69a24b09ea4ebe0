"""The pattern is as large on the vehicle as was asked for."""

from pathlib import Path

import pytest

from cnca import build
from cnca.attack.settings import Settings
from cnca.attack.variables import origin
from cnca.core.errors import RunError
from cnca.gen.period import period
from cnca.jobs.attack.pattern import TEXELS, at_size
from cnca.jobs.attack.request import Request
from cnca.jobs.attack.run import build_generator
from cnca.scene.load_scene import load_scene
from cnca.vehicle.uv.texels import map_texels

SCENE = "scenes/sedan_clear.yaml"


def request(**more):
    settings = Settings("zebra strips", steps=1, variable="noise")
    return Request(Path(SCENE), Path("out"), settings, ddim_steps=4, texture_size=256, **more)


@pytest.fixture(scope="module")
def vehicle():
    return build.build_vehicle(load_scene(SCENE))


@pytest.mark.parametrize("metres", [0.1, 0.3])
def test_marks_come_as_often_as_was_asked_for(vehicle, metres):
    asked = request(pattern_size=metres)
    generator = at_size(asked, build_generator(asked), vehicle)
    settings = asked.settings
    texture = origin(generator, settings).texture(generator, settings.prompt, settings.seed)
    side = map_texels(vehicle, TEXELS).texel_length * TEXELS
    on_the_vehicle = period(texture) / texture.shape[-1] * side
    assert on_the_vehicle == pytest.approx(metres, rel=0.3)


def test_without_a_size_nothing_repeats(vehicle):
    generator = build_generator(request())
    assert at_size(request(), generator, vehicle) is generator


def test_generators_that_do_not_repeat_are_refused(vehicle):
    with pytest.raises(RunError, match="does not repeat"):
        at_size(request(pattern_size=0.3), object(), vehicle)


@pytest.mark.parametrize("metres", [0.0, -1.0, float("nan"), float("inf")])
def test_sizes_that_are_none_are_refused(metres):
    with pytest.raises(RunError, match="pattern_size"):
        request(pattern_size=metres)
