"""The terminal: examples that parse, completion, quiet progress, no unwanted colors."""

import os
import re
import shlex
import subprocess
import sys
from io import StringIO

import pytest
import typer
from rich.console import Console
from typer.testing import CliRunner

from cnca.cli import app
from cnca.cli.examples import EXAMPLES
from cnca.cli.help import SUBJECTS
from cnca.core.errors import RunError
from cnca.core.progress import bar

ROOT = typer.main.get_command(app)


def _commands(group, prefix=""):
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from _commands(command, f"{prefix}{name} ")
        else:
            yield prefix + name, command


COMMANDS = dict(_commands(ROOT))


@pytest.mark.parametrize("name", COMMANDS)
def test_every_help_ends_with_an_example(name):
    answer = _cnca(*name.split(), "--help") if name == "doctor" else None
    shown = answer.stdout if answer else COMMANDS[name].epilog or ""
    assert f"  cnca {name}" in shown.split("Examples:")[-1]


@pytest.mark.parametrize("name", COMMANDS)
def test_examples_name_options_that_there_are(name):
    """The parser takes them; nothing is run."""
    for example in EXAMPLES[name]:
        words = shlex.split(example)
        assert words[: len(name.split())] == name.split()
        COMMANDS[name].make_context(name, words[len(name.split()) :])


def test_a_wrong_example_would_be_seen():
    with pytest.raises(RunError, match="--outt: not a flag"):
        COMMANDS["gallery"].make_context("gallery", ["--outt", "x.png"])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("optimize --stepps 5", "--stepps: not a flag of cnca optimize; did you mean '--steps'?"),
        ("optimize --view 5", "did you mean '--views-per-step'?"),
        ("survey serve a --prot 1", "not a flag of cnca survey serve; did you mean '--port'?"),
        ("optimize --quiet", "--quiet: stands before the command: cnca --quiet optimize"),
        ("optimize --xyzzy", "--xyzzy: not a flag of cnca optimize"),
    ],
)
def test_an_unknown_flag_names_the_nearest(words, message):
    error = CliRunner().invoke(app, words.split(), prog_name="cnca").exception
    assert isinstance(error, RunError)
    assert message in str(error)


@pytest.mark.parametrize(
    ("words", "flag"),
    [
        ("render-scene a.yaml -o b.png --out c.png", "-o or --out"),
        ("demo --steps 2 --steps 3", "--steps"),
        (
            "tradeoff --gradient-checkpointing --no-gradient-checkpointing",
            "--gradient-checkpointing or --no-gradient-checkpointing",
        ),
    ],
)
def test_a_flag_that_is_given_twice_is_refused(words, flag):
    words = [*words.split(), *(["--scene=a", "--prompt=b", "--out=c"] * ("trade" in words))]
    error = CliRunner().invoke(app, words, prog_name="cnca").exception
    assert isinstance(error, RunError)
    assert str(error).startswith(f"{flag} is given 2 times to cnca ")


def _help(name: str, width: int, monkeypatch) -> str:
    monkeypatch.setenv("COLUMNS", str(width))
    return COMMANDS[name].get_help(COMMANDS[name].context_class(COMMANDS[name]))


def test_help_comes_in_panels_of_the_terminals_width(monkeypatch):
    shown = _help("optimize", 70, monkeypatch)
    titles = re.findall(r"^╭─ (\w+) ", shown, re.MULTILINE)
    assert titles == ["What", "Strength", "Cost", "Output", "Options"]
    panels, _, examples = shown.partition("\nExamples:\n")
    assert max(map(len, panels.splitlines())) == 70
    assert "--no-gradient-checkpointing" in panels  # whole, however long
    assert examples.splitlines() == [f"  cnca {example}" for example in EXAMPLES["optimize"]]


def test_help_takes_brackets_as_they_are(monkeypatch):
    assert "[NAME=]PATH" in _help("survey build", 80, monkeypatch)


def test_all_commands_stand_in_a_panel_of_their_subject(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    shown = ROOT.get_help(ROOT.context_class(ROOT, info_name="cnca"))
    titles = re.findall(r"^╭─ ([\w ]+?) ─", shown, re.MULTILINE)
    assert titles == [*SUBJECTS, "Options"]
    assert all(re.search(rf"^│ {name} ", shown, re.MULTILINE) for name in ROOT.commands)


def _cnca(*arguments, **environment):
    return subprocess.run(
        [sys.executable, "-m", "cnca", *arguments],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | environment,
    )


def test_the_shell_completes_commands():
    answer = _cnca(_CNCA_COMPLETE="complete_bash", COMP_WORDS="cnca render-", COMP_CWORD="1")
    assert {"render-scene", "render-dataset"} <= set(answer.stdout.split())


def _shown(monkeypatch, **environment) -> str:
    for name in ("CNCA_QUIET", "NO_COLOR"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    console = Console(file=StringIO(), force_terminal=True, color_system="standard", width=100)
    with bar(console) as progress:
        list(progress.track(range(3), description="scenes"))
    return console.file.getvalue()


def test_progress_is_shown_unless_quiet(monkeypatch):
    assert "scenes" in _shown(monkeypatch)
    assert _shown(monkeypatch, CNCA_QUIET="1").strip() == ""


def test_quiet_is_an_option_before_the_command(monkeypatch):
    monkeypatch.delenv("CNCA_QUIET", raising=False)
    answer = _cnca("--quiet", "gallery", "nowhere")
    assert answer.returncode == 2
    assert answer.stderr.startswith("error: nowhere: no scene files")


def test_no_color_takes_the_colors_away(monkeypatch):
    color = re.compile(r"\x1b\[[0-9;]*3[0-7]")
    assert color.search(_shown(monkeypatch))
    assert not color.search(_shown(monkeypatch, NO_COLOR="1"))
