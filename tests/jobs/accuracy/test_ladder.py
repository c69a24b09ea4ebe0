"""``cnca accuracy``: reference, ladder, table and picture of a small scene."""

from __future__ import annotations

import json
from dataclasses import asdict
from types import SimpleNamespace

import pytest
import torch
from rich.console import Console

from cnca import cli
from cnca.core.errors import RunError
from cnca.core.records import as_json
from cnca.effects.plan import Demand
from cnca.jobs.accuracy import ladder as command
from cnca.jobs.accuracy import reference as reference_module
from cnca.jobs.accuracy.ladder import Rung, accuracy, pareto_front
from cnca.jobs.accuracy.price_list import describe_reference
from cnca.jobs.accuracy.records import ReferenceRecord
from cnca.jobs.accuracy.request import AccuracyRequest
from cnca.scene.load_scene import load_scene
from cnca.scene.views import build_views

QUIET = Console(quiet=True)

SCENE = """
vehicle: {mesh: builtin:sedan, texture_size: 16}
cameras: [{name: left, azimuth: 90, elevation: 10, distance: 8}]
image: {width: 32, height: 32, samples: 4}
"""
RUNGS = [
    Rung("plan for 20%", Demand(0.2), target=0.2),
    Rung("16 spp", Demand(forced={"samples": 16})),
    Rung("1 reflection", Demand(forced={"samples": 16, "interreflection": 1})),
    Rung("half resolution", Demand(forced={"samples": 16}), scale=0.5),
]


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("accuracy") / "scene.yaml"
    path.write_text(SCENE)
    return path


@pytest.fixture(scope="module")
def measured(scene):
    """The folder and the report of one run."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(command, "ladder", lambda: iter(RUNGS))
        patch.setattr(reference_module, "ROUND", 64)
        patch.setattr(reference_module, "MOST_ROUNDS", 2)
        report = accuracy(AccuracyRequest(scene, scene.parent / "out", 600), QUIET)
    return scene.parent / "out", report


def test_files_and_report_agree(measured):
    out, report = measured
    assert json.loads((out / "accuracy.json").read_text()) == as_json(report)
    table = (out / "accuracy.md").read_text()
    assert all(rung.name in table for rung in RUNGS)
    assert "Not reached in the time given: nothing." in table
    assert (out / "accuracy.png").stat().st_size > 10_000


def test_reference_says_how_well_its_halves_agree(measured):
    reference = measured[1].reference
    assert reference.samples == 2 * 2 * 64
    assert 0 < reference.standard_error < 0.1
    assert abs(reference.difference_of_means) < 0.05
    assert reference.gradient_cosine > 0.9
    assert reference.halves_agree
    assert reference.converged == (reference.standard_error < 0.005)


def test_errors_are_made_of_bias_and_noise(measured):
    rungs = {rung.name: rung for rung in measured[1].rungs}
    assert set(rungs) == {rung.name for rung in RUNGS}
    for rung in rungs.values():
        squares = sum(abs(part) * part for part in (rung.bias, rung.noise))
        assert rung.error**2 == pytest.approx(squares, rel=0.3)
        assert rung.seconds.steady.forward > 0
        assert rung.delta_e > 0
    one, two, half = (rungs[name] for name in ("1 reflection", "16 spp", "half resolution"))
    assert one.bias > max(two.bias, 0) + 0.02, "light from the ground is missing"
    assert half.bias > 0.05, "edges are blurred"
    assert abs(two.mean) < 0.02 + 3 * two.mean_error
    assert one.mean < -0.02 - 3 * one.mean_error, "the same light is missing from the mean"
    assert two.gradient_cosine > 0.9
    assert two.gradient_length == pytest.approx(1, abs=0.1)


def test_a_second_call_measures_nothing_again(measured, scene, monkeypatch):
    out, report = measured
    monkeypatch.setattr(command, "ladder", lambda: iter(RUNGS))
    monkeypatch.setattr(reference_module, "MOST_ROUNDS", 2)
    monkeypatch.setattr(command, "measure", lambda *arguments: pytest.fail("measured again"))
    again = accuracy(AccuracyRequest(scene, out, 600), QUIET)
    assert again.rungs == report.rungs


def test_a_damaged_report_is_refused_before_anything_is_rendered(scene, tmp_path):
    (tmp_path / "accuracy.json").write_text('{"rungs": []}')
    with pytest.raises(RunError, match=r"accuracy\.json: scene: Field required; delete it"):
        accuracy(AccuracyRequest(scene, tmp_path, 600), QUIET)
    assert not list(tmp_path.glob("reference_*"))


def test_what_the_budget_does_not_reach_is_named(measured, scene, monkeypatch, tmp_path):
    """The first rung takes so long that none with as many rays fits into what is left."""
    clock = SimpleNamespace(now=0.0, process_time=lambda: clock.now)

    def slow(*arguments):
        clock.now += 400
        return measured[1].rungs[0]

    monkeypatch.setattr(command, "time", clock)
    monkeypatch.setattr(command, "ladder", lambda: iter(RUNGS))
    monkeypatch.setattr(command, "measure", slow)
    monkeypatch.setattr(reference_module, "ROUND", 4)
    monkeypatch.setattr(reference_module, "MOST_ROUNDS", 1)
    report = accuracy(AccuracyRequest(scene, tmp_path, 600), QUIET)
    assert len(report.rungs) == 1
    assert len(report.not_reached) == len(RUNGS) - 1
    assert report.not_reached[0] in (tmp_path / "accuracy.md").read_text()


def test_another_scene_needs_another_reference(measured, scene):
    key = measured[1].reference.key
    assert [path.name for path in measured[0].glob("reference_*")] == [f"reference_{key}.pt"]
    darker = scene.with_name("darker.yaml")
    darker.write_text(SCENE + "sun: {altitude: 10}\n")
    loaded, other = (load_scene(path) for path in (scene, darker))
    view = build_views(loaded)[0]
    assert reference_module.fingerprint(loaded, view) == key
    assert reference_module.fingerprint(loaded, view, volpath=True) != key
    assert reference_module.fingerprint(other, view) != key


def test_the_front_holds_what_no_faster_rung_beats():
    def rung(name: str, seconds: float, error: float) -> SimpleNamespace:
        steady = SimpleNamespace(forward=seconds)
        return SimpleNamespace(name=name, seconds=SimpleNamespace(steady=steady), error=error)

    rungs = [rung("c", 3, 0.2), rung("a", 1, 0.5), rung("b", 2, 0.6), rung("d", 4, 0.1)]
    assert pareto_front(rungs) == ["a", "c", "d"]


def test_the_halves_never_share_random_numbers(monkeypatch, tmp_path):
    seeds = []

    class Bench:
        def shoot(self, demand, seed):
            seeds.append(seed)
            return torch.rand(1, 3, 2, 2), torch.rand(3, 2, 2), {}

        def pixels(self, image):
            return image[0].flatten(1).T.double().numpy()

    monkeypatch.setattr(reference_module, "MOST_ROUNDS", 3)
    path, deadline = tmp_path / "reference.pt", float("inf")
    found = reference_module.converge(Bench(), path, deadline, console=Console(quiet=True))
    assert found.rounds == 3
    assert len(set(seeds)) == 6


def test_without_a_budget_nothing_is_measured(tmp_path):
    with pytest.raises(RunError, match="--seconds 0"):
        AccuracyRequest(tmp_path / "x.yaml", tmp_path, seconds=0)


def test_the_command_says_how_good_reference_and_plans_are(measured, scene, monkeypatch, capsys):
    monkeypatch.setattr(command, "accuracy", lambda *arguments, **options: measured[1])
    monkeypatch.setattr("sys.argv", ["cnca", "accuracy", str(scene), "--out", "somewhere"])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert not ended.value.code
    printed = capsys.readouterr().out
    assert "Reference: our own renderer, 256 rays per pixel" in printed
    assert "plan for 20%: error" in printed
    assert "somewhere/accuracy.png" in printed


@pytest.fixture(scope="module")
def foggy(scene):
    path = scene.with_name("foggy.yaml")
    path.write_text(SCENE + "fog: {visibility: 60, height: 30}\nsky: {turbidity: 5}\n")
    return path


def test_volpath_is_the_truth_about_fog(foggy, monkeypatch):
    """The mean over the vehicle agrees with ours; without fog it does not."""
    rungs = [RUNGS[1], Rung("no fog", Demand(forced={"samples": 16, "fog": "none"}))]
    monkeypatch.setattr(command, "ladder", lambda: iter(rungs))
    monkeypatch.setattr(reference_module, "ROUND", 128)
    monkeypatch.setattr(reference_module, "MOST_ROUNDS", 1)
    out = foggy.parent / "volpath"
    report = accuracy(AccuracyRequest(foggy, out, 600, volpath=True), QUIET)
    usual, bare = report.rungs
    assert usual.mean_error < 0.05
    assert abs(usual.mean) < 0.04 + 3 * usual.mean_error  # README: 3 to 4 % at worst
    assert usual.bias < bare.bias / 2, "contrast that fog would take"
    assert bare.bias > bare.bias_hidden
    table = (out / "accuracy.md").read_text()
    assert "Reference: `volpath` (the gradients' is our own renderer" in table
    assert f"± {usual.mean_error:.2%}" in table


@pytest.mark.parametrize("fog", ["", "fog: {visibility: 60, height: 0}\n"])
def test_volpath_is_refused_where_there_is_no_fog(tmp_path, fog):
    (tmp_path / "clear.yaml").write_text(SCENE + fog)
    with pytest.raises(RunError, match=r"clear\.yaml: --volpath is for fog.*leave it out"):
        accuracy(AccuracyRequest(tmp_path / "clear.yaml", tmp_path, 60, volpath=True), QUIET)


def test_halves_that_differ_are_said_to():
    """By more than noise explains: one half is 10 % brighter than the other."""

    class Bench:
        def pixels(self, image):
            return image[0].flatten(1).T.double().numpy()

    def halves(factor: float) -> reference_module.Reference:
        torch.manual_seed(0)
        a, b = (1 + 0.1 * torch.randn(1, 3, 16, 16) for _ in range(2))
        gradients = [torch.ones(3, 2, 2)] * 2
        return reference_module.Reference(1, 0.0, [a, factor * b], gradients)

    same, other = (reference_module.agreement(Bench(), halves(factor)) for factor in (1.0, 1.1))
    assert same.halves_agree
    assert not other.halves_agree
    for volpath in (False, True):
        text = describe_reference(ReferenceRecord(**asdict(other), key="", volpath=volpath))
        assert "halves DO NOT AGREE" in text
        assert "(not converged)" in text
        assert ("`volpath`" in text) == volpath
