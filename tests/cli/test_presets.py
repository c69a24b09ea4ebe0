"""A preset gives what no flag says."""

import pytest
from typer.testing import CliRunner

from cnca.cli import app
from cnca.cli import attack as commands

OPTIMIZE = ["optimize", "--scene", "s.yaml", "--out", "out", "--prompt", "zebra"]


@pytest.fixture
def asked(monkeypatch) -> list:
    requests: list = []
    monkeypatch.setattr(commands, "run_attack", requests.append)
    return requests


def ask(*words: str):
    return CliRunner().invoke(app, [*OPTIMIZE, *words])


def test_nothing_else_gives_the_strongest(asked):
    assert ask().exit_code == 0
    (request,) = asked
    assert (request.settings.variable, request.objective) == ("noise", "odds")
    assert (request.texture_size, request.pattern_size) == (256, 0.25)
    assert request.minutes == 10


@pytest.mark.parametrize("words", [["--generator", "own"], ["--variable", "both"]])
def test_the_pattern_is_for_the_noises_of_the_shipped_generator(asked, words):
    assert ask(*words).exit_code == 0
    assert (asked[0].texture_size, asked[0].pattern_size) == (None, None)


@pytest.mark.parametrize("command", ["optimize", "prompts", "tradeoff"])
def test_the_help_shows_what_applies(command):
    words = " ".join(CliRunner().invoke(app, [command, "--help"]).output.replace("│", "").split())
    assert "(best: odds, paper: paper)" in words
    assert "(best: 0.1, paper: 0.01)" in words
    assert "(best: on, paper: off)" in words
    assert "(best: 10.0, paper: none)" in words


def test_flags_go_before_the_preset(asked):
    ask("--steps", "100", "--variable", "both", "--spp", "2")
    (request,) = asked
    assert request.minutes is None  # the default of the flag, but said
    assert request.settings.steps == 100
    assert request.settings.variable == "both"
    assert request.samples == 2
    assert request.settings.decay


def test_a_run_file_goes_before_the_preset(asked, tmp_path):
    file = tmp_path / "run.yaml"
    file.write_text("jitter: false\nddim-steps: 3\n")
    ask("--config", str(file))
    assert (asked[0].settings.jitter, asked[0].ddim_steps) == (False, 3)


def test_the_papers_setting(asked):
    ask("--preset", "paper")
    (request,) = asked
    assert (request.settings.variable, request.objective, request.ddim_steps) == (
        "feature",
        "paper",
        20,
    )
    assert (request.settings.learning_rate, request.minutes) == (0.01, None)


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--steps", "9", "--minutes", "3"], "the one decides the other"),
        (["--preset", "bset"], "did you mean 'best'"),
    ],
)
def test_what_does_not_go_together(asked, words, complaint):
    result = ask(*words)
    assert result.exit_code == 2 or complaint in str(result.exception)
    assert not asked
