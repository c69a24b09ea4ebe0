"""A time becomes a number of steps once, and that number is what is repeated."""

from dataclasses import replace
from pathlib import Path

import pytest

from cnca.attack.settings import WEATHERS, Settings
from cnca.core.errors import RunError
from cnca.core.run_folder import RunFolder
from cnca.jobs.attack import budget, presets
from cnca.jobs.attack.request import JOB, Request

SETTINGS = Settings("grey", views_per_step=8, view_pool=256)


@pytest.fixture
def request_(tmp_path) -> Request:
    return Request(Path("s.yaml"), tmp_path / "run", SETTINGS, minutes=2.0)


def test_no_more_steps_than_the_time_allows_and_not_one_less():
    seconds = (30.0, 3.0, 2.0, 1.0)
    for allowed in (60, 100, 250):
        steps = budget.steps_within(allowed, seconds, SETTINGS)
        costs = [
            sum(n * s for n, s in zip(budget.step_counts(one), seconds, strict=True))
            for one in (replace(SETTINGS, steps=k) for k in (steps, steps + 1))
        ]
        assert costs[0] <= allowed < costs[1]
    assert budget.steps_within(1, seconds, SETTINGS) == budget.LEAST
    assert budget.steps_within(1e6, seconds, SETTINGS) == budget.MOST


def test_the_first_process_decides_and_the_manifest_remembers(request_, monkeypatch):
    measured = []

    def measure(attack, settings):
        measured.append(settings)
        return [10.0, 1.0, 1.0, 1.0]

    monkeypatch.setattr(budget, "measure_steps", measure)
    first = budget.decided(request_, attack=None)
    assert first.settings.steps == 1 + round(0.7 * 120 - 10)
    assert first.minutes is None
    RunFolder(request_.out, JOB).claim(first.as_dict(), {}, resume=False)
    monkeypatch.setattr(budget, "measure_steps", lambda *_: [1.0, 0.1, 0.1, 0.1])
    again = budget.decided(replace(request_, resume=True), attack=None)
    assert again.settings.steps == first.settings.steps
    assert again.as_dict() == first.as_dict()
    assert len(measured) == 1


def test_without_a_time_the_steps_are_those_of_the_settings(request_):
    plain = replace(request_, minutes=None)
    assert budget.decided(plain, attack=None) is plain


@pytest.mark.parametrize("minutes", [0, -1, float("inf"), float("nan")])
def test_times_that_are_none(request_, minutes):
    with pytest.raises(RunError, match="minutes is"):
        replace(request_, minutes=minutes)


def test_steps_are_counted_by_what_they_meet():
    settings = replace(SETTINGS, views_per_step=8, view_pool=256, steps=40)
    assert budget.step_counts(settings) == (1, WEATHERS - 1, WEATHERS, 40 - 2 * WEATHERS)


def test_a_small_pool_has_few_weathers():
    settings = replace(SETTINGS, views_per_step=8, view_pool=48, steps=40)
    assert (settings.weathers, settings.pool_size) == (6, 48)
    assert budget.step_counts(settings) == (1, 5, 0, 34)
    assert replace(settings, view_pool=1).weathers == 1


def test_every_preset_makes_a_request(request_):
    for name in presets.PRESETS:
        made = presets.under_preset(request_, name)
        assert made.settings.prompt == "grey"
    best = presets.under_preset(request_, but=["decay", "texture_size"])
    assert (best.settings.variable, best.settings.decay, best.texture_size) == (
        "noise",
        False,
        None,
    )
    assert presets.under_preset(request_, "paper") == request_
    with pytest.raises(RunError, match="preset 'papper': .* did you mean 'paper'"):
        presets.preset("papper")
