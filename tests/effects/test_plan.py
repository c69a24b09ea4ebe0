"""Plans: what is in the scene, what is asked for, and what a target error leaves out."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import pytest

from cnca.core.errors import CncaError
from cnca.effects import daylight
from cnca.effects.catalog import EFFECTS, parse_effects
from cnca.effects.explain import explain
from cnca.effects.plan import Demand, plan, predicted_error, predicted_seconds
from cnca.effects.prices import Fit, Prices
from cnca.effects.subject import Subject
from cnca.scene.weather import KOSCHMIEDER, Fog, SkyMap, Weather

CLEAR = Subject(
    Weather(),
    ground=0.2,
    paint=0.3,
    fog_path=8.0,
    pixels_per_metre=30.0,
    amounts={"materials": 1.0, "glass": 0.0},
)
LADDERS = {name: effect.models for name, effect in EFFECTS.items()}


def holding(subject: Subject, **amounts: float) -> Subject:
    """With other materials."""
    return replace(subject, amounts={**subject.amounts, **amounts})


FOGGY = replace(CLEAR, weather=Weather(fog=Fog(60.0, 40.0)))
CONSTANT = (1.0, 0.0, 0.0, 0.0, 0.0)


def fit(error: float) -> Fit:
    """The same error for every subject."""
    return Fit(tuple(math.log(error) * one for one in CONSTANT), 0.0)


PRICES = Prices(
    errors={
        "fog=none": fit(2.0),
        "fog=airlight": fit(0.3),
        "fog=single": fit(0.04),
        "sun=direction": fit(0.01),
        "interreflection=1": fit(0.15),
        "interreflection=2": fit(0.02),
        "interreflection=3": fit(0.005),
        "interreflection=4": fit(0.001),
        "materials=principled": fit(0.08),
        "materials=diffuse": fit(0.3),
        "glass=dark": fit(0.5),
    },
    noise=Fit((*fit(0.1).weights, 0.0, -0.5), 0.0),
    seconds={
        "rays": 0.1,
        "interreflection": 0.02,
        "fog=airlight": 0.02,
        "fog=single": 0.03,
        "fog=field": 0.05,
        "sun=direction": 0.05,
        "sun=disc": 0.06,
        "materials=principled": 0.03,
        "materials=coat": 0.04,
        "glass=pane": 0.04,
    },
)


def test_usual_models():
    chosen = plan(CLEAR, Demand())
    assert chosen.models == {
        "fog": "none",
        "sun": "direction",
        "sky": "map",
        "surroundings": "none",
        "lamps": "off",
        "interreflection": 2,
        "caustics": "regularised",
        "wetness": "dry",
        "materials": "coat",
        "glass": "dark",
        "gradient": "texture",
        "samples": 16,
    }
    assert plan(FOGGY, Demand())["fog"] == "field"
    chosen = plan(CLEAR, Demand(), usual={"samples": 4, "interreflection": 5})
    assert (chosen.samples, chosen.bounces) == (4, 5)


@pytest.mark.parametrize("demand", [Demand(), Demand(0.05), Demand(reference=True)])
@pytest.mark.parametrize(
    ("weather", "effect", "model"),
    [
        (Weather(sun_altitude=-0.1), "sun", "off"),
        (Weather(sun_scale=0), "sun", "off"),
        (Weather(sky_scale=0), "sky", "off"),
        (Weather(fog=Fog(10.0, height=0.0)), "fog", "none"),
    ],
)
def test_what_the_scene_does_not_have_is_off(demand, weather, effect, model):
    subject = replace(CLEAR, weather=weather)
    assert plan(subject, demand, PRICES)[effect] == model
    row = next(r for r in explain(plan(subject, demand, PRICES), PRICES) if r.effect == effect)
    assert row.error == 0


@pytest.mark.parametrize(("contrast", "model"), [(0.2, "map"), (40.0, "map_mis")])
def test_a_measured_sky_is_sampled_by_brightness_where_its_contrast_asks_for_it(
    monkeypatch, contrast, model
):
    monkeypatch.setattr(daylight, "contrast", lambda weather: contrast)
    subject = replace(CLEAR, weather=Weather(sky_map=SkyMap("night.exr")))
    for demand in (Demand(), Demand(0.05), Demand(reference=True)):
        assert plan(subject, demand, PRICES)["sky"] == model
    row = next(r for r in explain(plan(subject, Demand(), PRICES), PRICES) if r.effect == "sky")
    assert row.why.startswith(f"night.exr, contrast {contrast:.1f}")
    dark = replace(subject, weather=replace(subject.weather, sky_scale=0.0))
    assert plan(dark, Demand())["sky"] == "off"


def test_windows_are_panes_where_they_let_enough_light_through():
    for glass, chosen in ((0.0, "dark"), (0.01, "dark"), (0.1, "pane")):
        assert plan(holding(CLEAR, glass=glass), Demand(0.05), PRICES)["glass"] == chosen


def test_a_matt_vehicle_has_no_coat():
    assert plan(holding(CLEAR, materials=0.0), Demand(reference=True))["materials"] == "principled"
    matt = plan(holding(CLEAR, materials=0.01), Demand(0.05), PRICES)
    assert matt["materials"] == "principled", "a hundredth of the coat changes 0.08 %"


def test_reference_takes_the_best_of_everything():
    everything = holding(FOGGY, glass=0.1, surroundings=1, lamps=3, wetness=0.5)
    everything = replace(everything, weather=replace(FOGGY.weather, lamps="on"))
    chosen = plan(everything, Demand(reference=True))
    best = {effect: ladder[-1] for effect, ladder in LADDERS.items()}
    assert chosen.models == best | {"sky": "map", "samples": 1024}


@pytest.mark.parametrize(
    ("weather", "lamps", "model", "why"),
    [
        (Weather(sun_altitude=-9), 0, "off", "nothing around the vehicle shines"),
        (Weather(sun_altitude=9), 5, "off", "the sun is up"),
        (Weather(sun_altitude=-9), 5, "sampled", "the sun is down, 5 of them"),
        (Weather(sun_altitude=-9, lamps="off"), 5, "off", "turned off"),
        (Weather(sun_altitude=9, lamps="on"), 5, "sampled", "turned on, 5 of them"),
    ],
)
def test_lamps_are_sampled_where_there_are_some_and_they_are_on(weather, lamps, model, why):
    chosen = plan(holding(replace(CLEAR, weather=weather), lamps=lamps), Demand())
    assert chosen["lamps"] == model
    row = next(row for row in explain(chosen, PRICES) if row.effect == "lamps")
    assert row.why.startswith(why)


@pytest.mark.parametrize(("wetness", "model"), [(0.0, "dry"), (0.3, "film")])
def test_wet_ground_is_a_film_and_dry_ground_none(wetness, model):
    assert plan(holding(CLEAR, wetness=wetness), Demand())["wetness"] == model


@pytest.mark.parametrize("visibility", [50_000.0, 1e9])
def test_thin_fog_is_left_out_and_the_plan_says_by_which_number(visibility):
    thin = replace(CLEAR, weather=Weather(sun_altitude=40, fog=Fog(visibility, 20.0)))
    chosen = plan(thin, Demand(0.05), PRICES)
    assert chosen["fog"] == "none"
    length = 8.0 + 20.0 / math.sin(math.radians(40))
    taken = 1 - math.exp(-KOSCHMIEDER / visibility * length)
    row = explain(chosen, PRICES)[0]
    assert f"at most {taken:.2%}" in row.why
    assert row.error == pytest.approx(2.0 * taken, rel=1e-3, abs=1e-6)
    assert plan(FOGGY, Demand(0.05), PRICES)["fog"] == "field"


@pytest.mark.parametrize("target", [0.3, 0.1, 0.05, 0.02, 0.01])
@pytest.mark.parametrize("subject", [CLEAR, FOGGY], ids=["clear", "fog"])
def test_the_plan_is_the_cheapest_under_the_target(subject, target):
    """Every other combination is dearer or over the target."""
    chosen = plan(subject, Demand(target), PRICES)
    assert predicted_error(chosen.models, subject, PRICES) <= target
    cost = chosen.samples * predicted_seconds(chosen.models, PRICES)
    fogs = LADDERS["fog"] if subject is FOGGY else ("none",)
    others = itertools.product(
        fogs, LADDERS["sun"][1:], LADDERS["interreflection"], LADDERS["materials"], range(13)
    )
    for fog, sun, bounces, materials, power in others:
        models = {"fog": fog, "sun": sun, "interreflection": bounces, "materials": materials}
        models["samples"] = 2**power
        glints = (sun, materials) == ("direction", "coat")
        if not glints and predicted_error(models, subject, PRICES) <= target:
            assert 2**power * predicted_seconds(models, PRICES) >= cost * (1 - 1e-9)


def test_a_sun_that_mirrors_in_lacquer_is_a_disc_unless_asked_for_by_name():
    """A direction's rare glints are beyond every mean error."""
    assert plan(CLEAR, Demand(0.02), PRICES).models["materials"] == "coat"
    assert plan(CLEAR, Demand(0.02), PRICES)["sun"] == "disc"
    assert plan(CLEAR, Demand(0.02, forced={"sun": "direction"}), PRICES)["materials"] == "coat"
    assert plan(holding(CLEAR, materials=0.0), Demand(0.2), PRICES)["sun"] == "direction"


def test_a_smaller_target_never_predicts_a_larger_error():
    targets = [0.5, 0.2, 0.1, 0.05, 0.02, 0.01]
    plans = [plan(FOGGY, Demand(t), PRICES) for t in targets]
    costs = [p.samples * predicted_seconds(p.models, PRICES) for p in plans]
    assert costs == sorted(costs)


def test_a_target_out_of_reach_is_said_to_be():
    chosen = plan(CLEAR, Demand(1e-6), PRICES)
    assert chosen["materials"] == "coat"
    assert "OVER the target" in explain(chosen, PRICES)[-1].why


def test_what_is_asked_for_by_name_stays():
    forced = {"sun": "disc", "interreflection": 7, "samples": 3, "fog": "none"}
    for demand in (Demand(forced=forced), Demand(0.02, forced=forced), Demand(None, True, forced)):
        chosen = plan(FOGGY, demand, PRICES)
        assert {effect: chosen[effect] for effect in forced} == forced
        assert chosen.weather.fog is None
    rows = {row.effect: row for row in explain(chosen, PRICES)}
    assert rows["fog"].why == "asked for by name"
    assert rows["fog"].error > 0


def test_a_model_without_a_price_is_never_chosen_and_said_to_have_none():
    unpriced = replace(PRICES, errors={k: e for k, e in PRICES.errors.items() if k != "fog=single"})
    assert plan(FOGGY, Demand(0.1), PRICES)["fog"] == "single"
    assert plan(FOGGY, Demand(0.1), unpriced)["fog"] == "field"
    row = explain(plan(FOGGY, Demand(forced={"fog": "single"}), unpriced), unpriced)[0]
    assert row.why == "asked for by name; its error was never measured and is not counted"
    priced = {"fog": "single", "sun": "direction", "caustics": "kept"}
    rows = explain(plan(FOGGY, Demand(forced=priced), PRICES), PRICES)
    assert not any("never measured" in row.why for row in rows)


def test_an_effect_that_the_scene_lacks_cannot_be_forced_into_it():
    assert plan(CLEAR, Demand(forced={"fog": "field"}), PRICES)["fog"] == "none"


def test_shares_of_the_time_add_up():
    rows = explain(plan(FOGGY, Demand(), PRICES), PRICES)
    assert sum(row.time_share for row in rows[:-1]) == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (["fogg=none"], "fogg.*did you mean 'fog'"),
        (["sun=disk"], "sun=disk.*did you mean 'disc'"),
        (["interreflection=0"], "whole number from 1 to 64"),
        (["samples=many"], "whole number from 1 to 65536"),
        (["fog"], "its models are none, airlight, single, field"),
    ],
)
def test_unknown_names_are_errors(settings, message):
    with pytest.raises(CncaError, match=message):
        parse_effects(settings)


def test_settings_are_read():
    assert parse_effects(["fog=none", "interreflection=5"]) == {
        "fog": "none",
        "interreflection": 5,
    }


@pytest.mark.parametrize("target", [0.0, -1.0, math.inf, math.nan])
def test_a_target_must_be_a_positive_number(target):
    with pytest.raises(CncaError, match="target error"):
        Demand(target)
