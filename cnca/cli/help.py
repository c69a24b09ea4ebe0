"""Commands that explain themselves in panels, and that take no flag twice."""

from __future__ import annotations

import inspect
import re
from collections import Counter
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from typer.core import TyperCommand, TyperGroup

from cnca.core.errors import RunError, did_you_mean
from cnca.core.options import PANELS

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    Rows = list[tuple[str, str]]
    """What is written for a flag, or a command's name, and what it does."""

BEGIN, ATTACK, JUDGE, RENDER = "Begin", "Attack", "Judge", "Render"
VEHICLES, TRAIN = "Vehicles and data", "Train"
SUBJECTS = (BEGIN, ATTACK, JUDGE, RENDER, VEHICLES, TRAIN)
"""Panels of commands, in this order."""
OTHER = "Options"
NAMES, WIDEST = 29, 100
"""Characters for the names of flags, and for a line, at most."""
GLOBAL = ("--quiet", "-q", "--memory-budget", "--figure-format", "--version")
"""Flags of ``cnca`` itself, which come before the command."""


class Command(TyperCommand):
    """One command: its flags in panels, and an error where a flag is given twice."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the command line.

        Raises RunError for a flag that does not exist, or that is given twice though only the last
        could count.
        """
        known = {name for flag in self.params for name in (*flag.opts, *flag.secondary_opts)}
        try:
            _, _, order = self.make_parser(ctx).parse_args(args=list(args))
            rest = super().parse_args(ctx, args)
        except Exception as error:
            unknown = getattr(error, "option_name", None)  # typer's error for it has no public name
            if unknown is None or unknown in known:
                raise
            raise RunError(_unknown(unknown, ctx.command_path, known)) from None
        for flag, times in Counter(order).items():
            if times > 1 and not flag.multiple:
                names = " or ".join([*flag.opts, *flag.secondary_opts])
                raise RunError(
                    f"{names} is given {times} times to {ctx.command_path}; give it once"
                )
        return rest

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write usage, what the command does, its flags by panel, and examples."""
        console = _console()
        with console.capture() as shown:
            _introduce(self, _usage(self, ctx), console)
            _print_panels(_flags(self, ctx), console)
            _print_examples(self, console)
        formatter.write(shown.get())


class Group(TyperGroup):
    """Several commands, in panels by what they are for."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write usage, the flags of the program itself, all commands, and where to begin."""
        console = _console()
        with console.capture() as shown:
            _introduce(self, f"{ctx.command_path} [OPTIONS] COMMAND [FLAGS]", console)
            _print_panels(self._rows(), console)
            _print_panels(_flags(self, ctx), console)
            _print_examples(self, console)
        formatter.write(shown.get())

    def _rows(self) -> dict[str, Rows]:
        """Panel → its commands, each with the first paragraph of its help."""
        panels: dict[str, Rows] = {subject: [] for subject in SUBJECTS}
        for name, command in self.commands.items():
            panel = getattr(command, "rich_help_panel", None) or "Commands"
            first = inspect.cleandoc(command.help or "").split("\n\n")[0]
            panels.setdefault(panel, []).append((name, " ".join(first.split())))
        return panels


def _unknown(name: str, command: str, known: Iterable[str]) -> str:
    if name in GLOBAL:
        program, _, rest = command.partition(" ")
        return f"{name}: stands before the command: {program} {name} {rest}"
    longer = sorted(flag for flag in known if flag.startswith(name))
    hint = f"; did you mean '{longer[0]}'?" if longer else did_you_mean(name, known)
    return f"{name}: not a flag of {command}{hint}"


def _usage(command: TyperCommand, ctx: Any) -> str:
    """What must be given, then that there is more."""
    needed = []
    for flag in command.get_params(ctx):
        record = flag.get_help_record(ctx)
        if flag.required and record is not None:
            needed.append(_without_dashes(record[0], flag))
    return " ".join([ctx.command_path, *needed, "[OPTIONS]"])


def _without_dashes(written: str, flag: Any) -> str:
    """An argument's name, or the shortest spelling of a flag with what stands for its value."""
    if flag.param_type_name == "argument":
        return flag.name.upper()
    return f"{min(flag.opts, key=len)} {written.split()[-1]}"


def _flags(command: TyperCommand | TyperGroup, ctx: Any) -> dict[str, Rows]:
    """Panel → its flags, in the order of :data:`PANELS`."""
    panels: dict[str, Rows] = {panel: [] for panel in (*PANELS, OTHER)}
    for flag in command.get_params(ctx):
        record = flag.get_help_record(ctx)
        if record is not None:
            name, meaning = record
            if flag.param_type_name == "argument":
                name = flag.name.upper()
            name = re.sub(r"<list\[(\w+)\]>", r"<\1> …", name)
            panel = getattr(flag, "rich_help_panel", None) or OTHER
            panels.setdefault(panel, []).append((name, meaning))
    return panels


def _console() -> Console:
    from rich.console import Console

    console = Console(highlight=False)
    return Console(highlight=False, width=min(console.width, WIDEST))


def _introduce(command: TyperCommand | TyperGroup, usage: str, console: Console) -> None:
    console.print(f"Usage: {usage}\n", markup=False, style="bold")
    for paragraph in inspect.cleandoc(command.help or "").split("\n\n"):
        console.print(" ".join(paragraph.split()) + "\n", markup=False)


def _print_examples(command: TyperCommand | TyperGroup, console: Console) -> None:
    """Without wrapping lines, so that they can be copied."""
    if command.epilog:
        console.print(f"\n{command.epilog}", soft_wrap=True, markup=False)


def _print_panels(panels: dict[str, Rows], console: Console) -> None:
    from rich.panel import Panel

    width = min(NAMES, max(len(name) for rows in panels.values() for name, _ in rows))
    for title, rows in panels.items():
        if rows:
            table = _table(rows, width)
            console.print(Panel(table, title=title, title_align="left", border_style="dim"))


def _table(rows: Rows, width: int) -> Table:
    from rich.table import Table
    from rich.text import Text

    table = Table.grid(padding=(0, 2))
    table.add_column(width=width, overflow="fold")
    table.add_column(overflow="fold")
    for name, meaning in rows:
        table.add_row(Text(name, style="bold cyan"), Text(meaning))
    return table
