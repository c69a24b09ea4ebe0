"""What commands say last: tables of the terminal's width, places, and what to try next."""

import shlex
from pathlib import Path

import pytest
import typer

from cnca.attack.settings import Settings
from cnca.cli import app, show
from cnca.jobs.attack.request import Request
from cnca.judge.summary import Summary
from cnca.report import MEANING

WIDTH = 44


@pytest.fixture(autouse=True)
def narrow(monkeypatch):
    monkeypatch.setenv("COLUMNS", str(WIDTH))


def _parse(said: str) -> list[str]:
    """The commands among the lines said, each taken by the parser without running it."""
    commands = [line.partition(": ")[2] for line in said.splitlines() if "cnca " in line]
    for command in commands:
        program, name, *rest = shlex.split(command)
        assert program == "cnca"
        typer.main.get_command(app).commands[name].make_context(name, rest)
    return commands


def test_an_attack_ends_with_the_picture_and_what_is_next(capsys):
    out = Path("out/a rather long name of a folder/zebra")
    request = Request(Path("my scene.yaml"), out, Settings("zebra"))
    summary = Summary(
        prompt="zebra",
        detector="builtin",
        scene="my scene.yaml",
        held_out_views=4,
        ratio_to_shuffled=0.25,
        ratio_to_controls=0.3,
        average_precision=dict.fromkeys(MEANING, 0.5),
        scores_per_view={},
        **{f"score_{name}": 0.125 for name in MEANING},
    )
    show.attack(request, summary)
    said = capsys.readouterr().out
    table, after = said[: said.rindex("┘")], said[said.rindex("┘") :].splitlines()
    assert max(map(len, table.splitlines())) <= WIDTH
    assert "…" not in table
    assert table.count("0.125") == len(MEANING)
    assert f"before and after: {out}/before_after.png" in after  # whole: it can be copied
    first, second, _ = _parse(said)
    assert shlex.split(first)[1:4] == ["evaluate", "--scene", "my scene.yaml"]
    assert shlex.split(second)[1] == "turntable"
    assert [line.partition(":")[0] for line in after[-3:]] == ["next", "or", "or"]


def test_words_longer_than_a_column_are_whole(capsys):
    row = ["interreflections", "Hosek–Wilkie-with-turbidity", "0.25 [0.20, 0.30]"]
    show.table(["effect", "why", "error"], [row])
    said = capsys.readouterr().out
    assert "…" not in said
    assert max(map(len, said.splitlines())) <= WIDTH
    assert all(word in said for word in [*" ".join(row).split(), "why", "error"])


def test_a_table_that_is_narrow_enough_has_its_headings_on_top(capsys):
    show.table(["effect", "why", "error"], [["sun", "clear", "0.25 [0.20, 0.30]"]])
    first = capsys.readouterr().out.splitlines()[1]
    assert all(word in first for word in ("effect", "why", "error"))


def test_cells_are_no_markup(capsys):
    show.table(["name"], [["[bold]x"]])
    assert "[bold]x" in capsys.readouterr().out
