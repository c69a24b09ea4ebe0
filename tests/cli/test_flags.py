"""Command lines that once worked go on working: flags are compared with the list in flags.txt.

A line of the list is ``COMMAND FLAGS: TYPE DEFAULT``, as of version 0.1.  New flags need no line;
a flag that goes or changes its meaning changes its line and is named in CHANGELOG.md.
"""

from pathlib import Path

import pytest
import typer

from cnca.cli import app

KEPT = Path(__file__).with_name("flags.txt").read_text(encoding="utf-8").splitlines()


def _lines(group, prefix: str = ""):
    """What the list says of every flag and argument below a group of commands."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from _lines(command, f"{prefix}{name} ")
        else:
            yield from (f"{prefix}{name} {_describe(flag)}" for flag in command.params)


def _describe(flag) -> str:
    positional = flag.param_type_name == "argument"
    names = [flag.name.upper()] if positional else sorted([*flag.opts, *flag.secondary_opts])
    kind = flag.type_descriptor.annotation
    kind = kind.__name__ if isinstance(kind, type) else str(kind).replace("pathlib.", "")
    if flag.multiple or flag.nargs != 1:
        kind += " repeatable"
    return f"{'/'.join(names)}: {kind} {_default(flag)}"


def _default(flag) -> str:
    return "required" if flag.required else str(flag.default)


def _lost(kept: list[str]) -> list[str]:
    """The lines that today's program does not keep to."""
    return sorted(set(kept) - set(_lines(typer.main.get_command(app))))


def test_every_flag_is_what_it_was():
    assert _lost(KEPT) == []


def test_the_list_is_long_and_in_order():
    assert sorted(set(KEPT)) == KEPT
    assert len(KEPT) > 200


@pytest.mark.parametrize(
    "line",
    ["optimize --steps: int 80", "optimize --steps: float 100", "optimize --step: int 100"],
)
def test_a_flag_that_changed_is_seen(line):
    assert _lost([*KEPT, line]) == [line]
