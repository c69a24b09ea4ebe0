"""Three of the newcomer's five tasks; the other two are in ``tests/core/test_plugins.py``."""

import numpy as np
import pytest

from cnca.build import build_worlds
from cnca.core.errors import CncaError
from cnca.core.images import write_exr
from cnca.effects.catalog import EFFECTS, parse_effects
from cnca.effects.explain import explain
from cnca.effects.plan import Demand, plan
from cnca.effects.subject import Subject
from cnca.mi_bridge.light import lambertian_white, make_light
from cnca.scene.cameras import Spot
from cnca.scene.load_scene import load_scene
from cnca.scene.weather import Weather
from cnca.world.builtin import BUILTIN_WORLDS
from tests.own_scene import AerosolEffect, overcast, plaza

GREY = np.full(3, 0.2)


@pytest.fixture
def aerosol(monkeypatch):
    """The line that :mod:`cnca.effects.catalog` would have."""
    monkeypatch.setitem(EFFECTS, "aerosol", AerosolEffect())


def subject(turbidity: float) -> Subject:
    return Subject(
        Weather(turbidity=turbidity),
        ground=0.2,
        paint=0.3,
        fog_path=0.0,
        pixels_per_metre=30.0,
        amounts=dict.fromkeys(EFFECTS, 0.0),
    )


@pytest.mark.usefixtures("aerosol")
def test_an_effect_of_ones_own_is_planned_explained_and_left_out():
    usual = plan(subject(6.0), Demand())
    assert (usual["aerosol"], usual.weather.turbidity) == ("sky", 6.0)
    assert plan(subject(1.0), Demand())["aerosol"] == "off"
    forced = plan(subject(6.0), Demand(forced=parse_effects(["aerosol=off"])))
    assert forced.weather.turbidity == 1.0
    why = {row.effect: row.why for row in explain(usual)}
    assert why["aerosol"].startswith("turbidity 6")
    with pytest.raises(CncaError, match=r"aerosol=of: its models are off, sky; did you mean 'off'"):
        parse_effects(["aerosol=of"])


@pytest.mark.usefixtures("aerosol")
def test_what_an_effect_leaves_out_is_not_in_the_light():
    left_out = plan(subject(6.0), Demand(forced={"aerosol": "off"})).weather
    skies = [make_light(w, GREY).sky for w in (left_out, Weather(turbidity=1.0), Weather())]
    np.testing.assert_array_equal(skies[0], skies[1])
    assert abs(skies[0] - skies[2]).max() > 0


def test_a_sky_of_ones_own_is_a_picture(tmp_path):
    """On level ground the CIE's overcast sky has the irradiance 7/9 π, upright 0.396 of that."""
    write_exr(tmp_path / "overcast.exr", {"": overcast(64)})
    (tmp_path / "scene.yaml").write_text("sky: {map: overcast.exr}\n")
    weather = load_scene(tmp_path / "scene.yaml").weather()
    light = make_light(weather, GREY)
    assert not light.sun_irradiance.any()
    white = lambertian_white(light.sky, light.sun_irradiance, light.sun_direction)
    assert white == pytest.approx(7 / 9 * (1 + 0.396) / 2, rel=0.01)


def test_a_world_of_ones_own_is_a_function_under_its_name(tmp_path, monkeypatch):
    monkeypatch.setitem(BUILTIN_WORLDS, "plaza", plaza)
    (tmp_path / "scene.yaml").write_text("world: {file: builtin:plaza, place: 1}\n")
    worlds = build_worlds(load_scene(tmp_path / "scene.yaml"))
    world, other = worlds(Spot()), worlds(Spot(seed=1))
    (house,) = (piece.vertices for piece in world.pieces if piece.surface == "concrete")
    # The vehicle stands 15 m left of the house's middle and heads along +y: the house lies right.
    assert house[:, 0].min() == pytest.approx(10.0)
    assert house[:, 1].mean() == pytest.approx(-15.0)
    (again,) = (piece.vertices for piece in other.pieces if piece.surface == "concrete")
    assert again[:, 2].max() != house[:, 2].max()
