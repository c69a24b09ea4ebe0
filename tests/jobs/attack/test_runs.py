"""Tables of several attacks, and the search for τ, over runs that take no time."""

import json
import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from cnca.attack.settings import Settings
from cnca.core.errors import RunError
from cnca.core.images import write_texture_srgb
from cnca.core.manifest import write_json
from cnca.core.records import as_json
from cnca.jobs.attack import auto_tau, runs
from cnca.jobs.attack.request import Request
from cnca.jobs.attack.run import claim
from cnca.judge.summary import Summary
from cnca.scene.load_scene import load_scene

QUIET = Console(quiet=True)


class Brightness:
    """The brighter a picture, the better it fits any prompt."""

    def score(self, pictures, prompts):
        return pictures.mean(dim=(1, 2, 3))[:, None].expand(-1, len(prompts))


@pytest.fixture
def started(monkeypatch) -> list[Request]:
    """Replaces the attack: its texture darkens with τ, its detection score is 1 / (1 + τ)."""
    requests: list[Request] = []

    def attack(request, console):
        requests.append(request)
        grey = 1 / (1 + request.settings.tau)
        request.out.mkdir(parents=True, exist_ok=True)
        for name, value in (("texture.png", grey), ("texture_prompt.png", 1.0)):
            write_texture_srgb(request.out / name, np.full((8, 8, 3), value, np.float32))
        summary = Summary(
            prompt=request.settings.prompt,
            detector="builtin",
            scene=str(request.scene),
            held_out_views=1,
            score_prompt=1.0,
            score_shuffled=1.0,
            score_after=grey,
            ratio_to_shuffled=grey,
            average_precision={"after": grey},
            scores_per_view={"after": [grey]},
        )
        write_json(request.out / "summary.json", as_json(summary))
        claim(request, load_scene(request.scene), resume=True)
        return summary

    monkeypatch.setattr(runs, "run", attack)
    return requests


@pytest.fixture
def request_(tmp_path) -> Request:
    scene = tmp_path / "scene.yaml"
    scene.write_text("vehicle: {texture_size: 32}")
    return Request(scene, tmp_path / "table", Settings("zebra", tau=1.0))


def test_tradeoff_writes_the_papers_table_and_goes_on_where_it_was(started, request_):
    taus = [0.0, 1.0, math.inf]
    rows = runs.tradeoff(request_, taus[:2], Brightness(), QUIET)
    assert [row.naturalness.prompt_score for row in rows] == pytest.approx([1, 0.5], abs=0.01)
    assert rows[1].naturalness.distance == pytest.approx(0.5, abs=0.01)
    runs.tradeoff(request_, taus, Brightness(), QUIET)
    assert [one.settings.tau for one in started] == taus  # the first two were read
    table = (request_.out / "tradeoff.md").read_text()
    assert table.count("\n") == 2 + len(taus)
    assert "| τ = inf | 0.000 | 1.000 | 0.000 |" in table
    numbers = json.loads((request_.out / "tradeoff.json").read_text())["rows"]
    assert [n["folder"] for n in numbers] == ["tau_0", "tau_1", "tau_inf"]
    assert cv2.imread(str(request_.out / "tradeoff.png")).shape == (246, 3 * 224, 3)


def test_prompts_have_a_folder_each(started, request_):
    runs.prompts(request_, ["zebra strips", "Balls, big!"], Brightness(), QUIET)
    assert [one.out.name for one in started] == ["zebra_strips", "Balls_big"]
    assert [one.settings.prompt for one in started] == ["zebra strips", "Balls, big!"]
    assert "| Balls, big! | 0.500 |" in (request_.out / "prompts.md").read_text()


def test_runs_of_another_request_are_not_mistaken_for_ours(started, request_):
    runs.tradeoff(request_, [1.0], Brightness(), QUIET)
    other = replace(request_, settings=replace(request_.settings, steps=7))
    with pytest.raises(
        RunError, match=r"tau_1: was started with another settings.steps \(was 100, now 7\)"
    ):
        runs.tradeoff(other, [1.0], Brightness(), QUIET)


def test_a_finished_run_of_a_scene_that_has_changed_since_is_not_taken_for_ours(started, request_):
    runs.tradeoff(request_, [1.0], Brightness(), QUIET)
    request_.scene.write_text("vehicle: {texture_size: 64}")
    with pytest.raises(RunError, match=r"scene\.yaml: has changed since .*tau_1 was started"):
        runs.tradeoff(request_, [1.0], Brightness(), QUIET)


@pytest.mark.parametrize("least", [0.3, 0.45, 0.6, 0.9])
def test_auto_tau_lands_where_the_exhaustive_sweep_does(started, request_, monkeypatch, least):
    monkeypatch.setattr(auto_tau, "_score_of_prompt", lambda request, scorer: 1.0)
    choice = auto_tau.auto_tau(request_, least, Brightness(), QUIET)
    # Textures are stored in 8 bits: the score is that of the rounded grey.
    kept = [tau for tau in auto_tau.GRID if round(255 / (1 + tau)) / 255 >= least]
    assert choice.tau == max(kept)
    assert len(started) <= math.ceil(math.log2(len(auto_tau.GRID) + 1))
    assert json.loads((request_.out / "auto_tau.json").read_text())["tau"] == choice.tau


def test_auto_tau_says_when_too_much_is_asked(started, request_, monkeypatch):
    monkeypatch.setattr(auto_tau, "_score_of_prompt", lambda request, scorer: 0.97)
    with pytest.raises(RunError, match="with F_adv = 0 'zebra' scores 0.970; ask for less"):
        auto_tau.auto_tau(request_, 0.99, Brightness(), QUIET)
    assert not started
    with pytest.raises(RunError, match="τ = 0.05 already scores 0.95"):
        auto_tau.auto_tau(request_, 0.96, Brightness(), QUIET)
    with pytest.raises(RunError, match="ask for less"):
        auto_tau.auto_tau(request_, math.nan, Brightness(), QUIET)


@given(st.integers(0, 12), st.integers(0, 12))
def test_bisection_asks_both_sides_of_the_turn(length, kept):
    asked = []

    def keeps(value):
        asked.append(value)
        return value < kept

    auto_tau.bisect(tuple(range(length)), keeps)
    assert {min(kept, length) - 1, min(kept, length)} - set(asked) <= {-1, length}
    assert len(asked) == len(set(asked)) <= math.ceil(math.log2(length + 1))


def test_the_strongest_that_keeps_is_not_always_the_largest_bound():
    found = {0.1: (0.9, 0.8), 0.5: (0.7, 0.5), 1.0: (0.6, 0.55), 2.0: (0.3, 0.1)}
    assert auto_tau.strongest(found, 0.6) == 0.5
    assert auto_tau.strongest(found, 0.8) == 0.1
    assert auto_tau.strongest(found, 0.95) is None


@pytest.mark.parametrize("text", ["-0.5", "nan", "much", "", "0.1,,1", "1,1"])
def test_bounds_that_are_none(text):
    with pytest.raises(RunError):
        runs.read_taus(text)


def test_bounds_of_the_paper():
    assert runs.read_taus("0.1,0.5,1,1.5,inf") == [0.1, 0.5, 1.0, 1.5, math.inf]


def test_prompts_without_letters(request_):
    with pytest.raises(RunError, match="has no letters"):
        runs.with_prompt(request_, "!?")


def test_unbounded_requests_can_be_written_down(request_):
    assert runs.with_tau(request_, math.inf).as_dict()["settings"]["tau"] == "inf"
    json.dumps(runs.with_tau(request_, math.inf).as_dict(), allow_nan=False)
