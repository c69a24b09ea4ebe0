"""Pictures that are made for a target: rays go where the noise is, and what is measured is true."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from cnca import build, cli
from cnca.core.errors import RunError
from cnca.effects.plan import Demand
from cnca.effects.prices import shipped_prices
from cnca.effects.proposals import best_models, propose
from cnca.effects.subject import Subject
from cnca.jobs.accuracy.fidelity import root, squared_error, vehicle_pixels
from cnca.jobs.accuracy.pilot import Pilot
from cnca.jobs.accuracy.spending import variance, wanted, whole
from cnca.jobs.accuracy.streams import Streams
from cnca.jobs.accuracy.targets import Scenery, meet, spend
from cnca.jobs.render_request import RenderRequest
from cnca.scene.schema import Scene
from cnca.scene.views import build_views
from cnca.scene.weather import Weather

SIDE = 32
SPREAD = np.where(np.arange(SIDE**2) % SIDE < SIDE // 2, 0.05, 0.4)
"""Noise of one ray: the right half of the picture is noisy."""


def draw(pixels, seed, first, *, truth=0.5, rays=2):
    """Gaussian noise that depends on the seed and the ray alone."""
    noise = np.random.default_rng([seed, first]).normal(size=(SIDE**2, 3))[pixels]
    return truth + SPREAD[pixels, None] * noise / rays**0.5


def streams(**more) -> Streams:
    return Streams(draw, np.arange(SIDE**2), rays=2, seeds=(1, 2), **more)


def test_the_difference_of_both_streams_is_the_noise():
    kept = streams()
    kept.advance(8)
    true = (SPREAD**2 / (2 * 2 * 8)) / (0.5**2 + 0.01)
    for half in (SPREAD < 0.1, SPREAD > 0.1):
        ratio = kept.noise()[half].mean() / true[half].mean()
        assert 0.9 < ratio < 1.25, "it errs upwards, where it is large"
    assert kept.rays_spent == 2 * 2 * 8 * SIDE**2


def test_the_fewest_rays_that_reach_a_goal():
    """Closed form (Neyman 1934): n = √v mean(√v) / goal, where nothing was spent before."""
    v = np.array([1.0, 4.0, 9.0, 16.0])
    n = wanted(v, np.zeros(4, dtype=np.int64), 0.05)
    assert n == pytest.approx(np.sqrt(v) * np.sqrt(v).mean() / 0.05, rel=1e-6)
    spent = np.array([1000, 0, 0, 0])
    n = wanted(v, spent, 0.05)
    assert n[0] == 1000
    assert np.mean(v / n) == pytest.approx(0.05, rel=1e-6)


def test_rounding_keeps_the_mean():
    steps = np.full(1000, 0.3)
    assert whole(steps, 1).mean() == pytest.approx(0.3, abs=0.01)
    assert not (whole(steps, 1) == whole(steps, 2)).all()


def test_variance_is_that_of_the_neighborhood():
    group = np.ones((SIDE, SIDE), dtype=bool)
    v = variance(np.where(SPREAD > 0.1, 1.0, 0.0), np.full(SIDE**2, 3), group)
    assert v.mean() == pytest.approx(1.5, rel=1e-6)
    assert v[0] == pytest.approx(0.75)
    assert v[SIDE - 1] == pytest.approx(2.25)
    border = SIDE // 2 - 1, SIDE // 2
    assert 0.75 < v[border[0]] < v[border[1]] < 2.25


@pytest.mark.parametrize("goal", [0.1, 0.03])
def test_rays_end_when_the_error_lies_just_under_the_goal(goal):
    kept, focus = streams(), np.zeros((SIDE, SIDE), dtype=bool)
    focus[:, 8:24] = True
    spend(kept, focus, goal**2)
    inside = focus.ravel()
    true = np.mean((kept.mean - 0.5)[inside] ** 2 / (0.5**2 + 0.01)) ** 0.5
    assert 0.7 * goal < true < 1.1 * goal
    quiet, noisy = (kept.steps[inside & (SPREAD > 0.1) == which].mean() for which in (False, True))
    assert noisy > 1.2 * quiet
    assert kept.steps[~inside].mean() <= 1.05 * kept.steps[inside].mean()


SUBJECT = Subject(
    Weather(),
    ground=0.3,
    paint=0.3,
    fog_path=8.0,
    pixels_per_metre=20.0,
    amounts={"materials": 1.0, "glass": 0.0},
)
BIAS = {1: 0.2, 2: 0.03, 3: 0.002, 4: 0.001, 8: 0.0}
"""Of so many reflections, in parts of white."""


def pilot(target: float) -> tuple[Pilot, dict]:
    def models(chosen):
        bias = 0.5 + BIAS[chosen["interreflection"]] * 0.5
        return lambda pixels, seed, first: draw(pixels, seed, first, truth=bias)

    found = Pilot(
        models,
        np.arange(SIDE**2),
        SIDE**2,
        subject=SUBJECT,
        forced={},
        prices=shipped_prices(),
        rays=2,
        seeds=(3, 4),
    )
    return found, dict(found.choose(target).models)


def test_the_pilot_measures_biases_far_below_the_noise():
    found, _ = pilot(0.05)
    for trial in found.trials[1:]:
        expected = (BIAS[trial.models["interreflection"]] * 0.5) ** 2 / (0.5**2 + 0.01)
        assert trial.bias_square == pytest.approx(expected, rel=0.1, abs=1e-7)
    assert found.trials[0].noise > 0.2


@pytest.mark.parametrize(("target", "least"), [(0.01, 3), (0.05, 2)])
def test_models_whose_bias_exceeds_the_target_are_not_taken(target, least):
    _, chosen = pilot(target)
    assert chosen["interreflection"] >= least
    assert chosen["caustics"] == "regularised"


def test_what_was_tried_is_not_proposed_again():
    free = list(best_models(SUBJECT, {}))
    tried = []
    for _ in range(3):
        models = propose(
            SUBJECT, 0.1, free=free, forced={}, prices=shipped_prices(), scale=0.5, tried=tried
        )
        assert models is not None
        assert models not in tried
        tried.append(models)
    forced = {"interreflection": 7, "sun": "disc"}
    models = propose(SUBJECT, 0.1, free=free, forced=forced, prices=shipped_prices())
    assert models is not None
    assert {name: models[name] for name in forced} == forced


@pytest.fixture(scope="module")
def scenery():
    scene = Scene.model_validate(
        {
            "vehicle": {"mesh": "builtin:sedan", "texture_size": 16},
            "cameras": [{"name": "left", "azimuth": 70, "elevation": 15, "distance": 7}],
            "image": {"width": 64, "height": 48},
        }
    )
    vehicle = build.build_vehicle(scene)
    paint = build.build_paint(scene, vehicle).apply()
    renderer = build.build_renderer(scene, vehicle)
    return Scenery(renderer, paint, build_views(scene)[0], scene.weather(), {})


@pytest.fixture(scope="module")
def reference(scenery):
    renderer, view = scenery.renderer, scenery.view
    mask = renderer.vehicle_mask([view])[0] == 1
    demand = Demand(reference=True, forced={"samples": 512, "gradient": "off"})

    def picture(seed):
        return renderer.render(scenery.albedo, [view], scenery.weather, seed=seed, demand=demand)

    return mask, tuple(vehicle_pixels(picture(seed), mask) for seed in (900, 901))


@pytest.mark.parametrize("target", [0.2, pytest.param(0.08, marks=pytest.mark.slow)])
def test_a_target_is_met(scenery, reference, target):
    mask, halves = reference
    image, plan, measured = meet(scenery, target=target, seed=1)
    square, _ = squared_error(vehicle_pixels(image, mask), halves)
    assert 0.5 * target < root(square) < 1.1 * target
    assert measured.error <= target
    assert measured.error**2 == pytest.approx(measured.bias**2 + measured.noise**2)
    assert plan.demand.target_error == target
    assert plan.samples == round(measured.samples)


@pytest.mark.slow
def test_seconds_are_kept_to_and_used(scenery):
    few, many = (meet(scenery, seconds=seconds, seed=2)[2] for seconds in (3.0, 9.0))
    assert many.samples > few.samples
    assert many.error < few.error
    assert many.seconds < 9.0 * 1.3


def test_models_asked_for_by_name_stay(scenery):
    forced = replace(scenery, forced={"interreflection": 1})
    _, plan, _ = meet(forced, target=0.5, seed=0)
    assert plan["interreflection"] == 1


@pytest.mark.parametrize("given", [{}, {"target": 0.1, "seconds": 1.0}])
def test_one_of_error_and_seconds_is_given(scenery, given):
    with pytest.raises(RunError, match="give one of them"):
        meet(scenery, **given)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"target_seconds": 0.0}, "give a number above 0"),
        ({"target_seconds": 3.0, "samples": 4}, "leave --spp out"),
        ({"target_seconds": 3.0, "target_error": 0.1}, "leave --target-error out"),
    ],
)
def test_targets_that_conflict_are_refused(tmp_path, given, message):
    with pytest.raises(RunError, match=message):
        RenderRequest(tmp_path / "s.yaml", tmp_path / "a.png", **given)


def test_the_command_says_what_was_measured(monkeypatch, tmp_path, capsys):
    scene = tmp_path / "s.yaml"
    scene.write_text("vehicle: {texture_size: 16}\nimage: {width: 40, height: 32}\n")
    arguments = ["render-scene", str(scene), "-o", str(tmp_path / "a.png"), "--target-seconds", "2"]
    monkeypatch.setattr("sys.argv", ["cnca", *arguments])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert not ended.value.code
    assert "processor seconds" in capsys.readouterr().out
    record = json.loads((tmp_path / "a.json").read_text())
    measured = record["measured"]
    assert record["plan"][-1]["error"] == pytest.approx(measured["error"], abs=1e-6)
    assert record["plan"][-1]["why"].startswith("measured: bias of the models at most")
