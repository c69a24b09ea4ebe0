"""``--config RUN.yaml``: flags from a file, by the names that the command has for them."""

import math

import pytest
from typer.testing import CliRunner

from cnca.cli import attack, evaluate
from cnca.cli.app import app
from cnca.core.errors import RunError
from cnca.jobs.attack.request import Request


@pytest.fixture
def asked(monkeypatch):
    """The requests that the command line came to."""
    requests: list[Request] = []
    monkeypatch.setattr(attack, "run_attack", requests.append)
    return requests


@pytest.fixture
def write(tmp_path):
    def to_file(text: str) -> str:
        file = tmp_path / "run.yaml"
        file.write_text(text)
        return str(file)

    return to_file


def _cnca(*arguments: str):
    return CliRunner().invoke(app, ["optimize", *arguments], catch_exceptions=True)


FILE = """
scene: builtin:sedan_clear
prompt: zebra strips
out: out/zebra
steps: 220
views-per-step: 4
decay: true
tau: .inf
generator:
"""


def test_the_file_stands_in_for_flags_and_flags_go_before_it(asked, write):
    answer = _cnca("--config", write(FILE), "--steps", "5")
    assert answer.exit_code == 0, answer.output
    [request] = asked
    assert (request.settings.steps, request.settings.views_per_step) == (5, 4)
    assert request.settings.decay is True
    assert request.settings.prompt == "zebra strips"
    assert (str(request.scene), str(request.out)) == ("builtin:sedan_clear", "out/zebra")
    assert request.generator is None
    assert request.settings.tau == math.inf


def test_a_repeatable_flag_may_stand_alone(asked, write):
    common = "scene: a.yaml, out: b, prompt: c"
    _cnca("--config", write(f"{{{common}, detector: builtin}}"))
    _cnca("--config", write(f"{{{common}, detector: [builtin, a.cfg=0.5]}}"))
    assert [request.detectors for request in asked] == [("builtin",), ("builtin", "a.cfg=0.5")]


def test_evaluate_takes_one_too(monkeypatch, write):
    found = []
    monkeypatch.setattr(evaluate, "_judge_views", found.append)
    text = "{out: out/evidence, scene: a.yaml, texture: [out/run, b.png], views: 12}"
    answer = CliRunner().invoke(app, ["evaluate", "--config", write(text), "--seed", "3"])
    assert answer.exit_code == 0, answer.output
    [request] = found
    assert (request.textures, request.views, request.seed) == (("out/run", "b.png"), 12, 3)


def test_it_says_the_same_as_flags(asked, write):
    _cnca("--config", write("{scene: a.yaml, out: b, prompt: c, learning_rate: 0.05}"))
    _cnca("--scene", "a.yaml", "--out", "b", "--prompt", "c", "--learning-rate", "0.05")
    assert asked[0] == asked[1]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("stepps: 3", "stepps: not a flag of cnca optimize; did you mean 'steps'?"),
        ("config: other.yaml", "config: not a flag"),
        ("- steps", "a run file maps flags to values"),
        ("steps: [", "cannot be read as YAML"),
    ],
)
def test_a_mistake_is_one_line(asked, write, text, message):
    error = _cnca("--config", write(text)).exception
    assert isinstance(error, RunError)
    assert message in str(error)
    assert "\n" not in str(error)
    assert not asked


def test_a_missing_file_and_a_wrong_value_are_named(asked, write):
    assert isinstance(_cnca("--config", "nowhere.yaml").exception, RunError)
    wrong = _cnca("--config", write(FILE + "seed: many"))
    assert wrong.exit_code == 2
    assert "--seed" in wrong.output
    assert not asked


def test_a_flag_in_two_spellings_is_refused(asked, write):
    answer = _cnca("--config", write(FILE + "views_per_step: 2\n"))
    assert isinstance(answer.exception, RunError)
    assert "views_per_step: stands there twice" in str(answer.exception)
