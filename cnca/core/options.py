"""What a field of a record says to people who fill it: the command line makes a flag of it.

A record writes ``steps: Annotated[int, Flag("Updates of F_adv.", STRENGTH)] = 100``; its name, type
and default are the flag's.  :mod:`cnca.cli.options` reads it, and nothing here knows of it.
"""

from __future__ import annotations

from dataclasses import dataclass

WHAT, STRENGTH, COST, OUTPUT = "What", "Strength", "Cost", "Output"
PANELS = (WHAT, STRENGTH, COST, OUTPUT)
"""Parts of a command's help, in this order: what is worked on, how strongly, what it costs in time
and memory, and where the results go."""


@dataclass(frozen=True)
class Flag:
    """One flag of the command line; a field without one is not asked for."""

    help: str
    panel: str = WHAT
    """One of :data:`PANELS`."""
    name: str | None = None
    """With underscores, where it is another than the field's: ``spp`` for ``samples``."""
    short: str | None = None
    """One letter that does as well: ``o`` for ``-o``."""
    metavar: str | None = None
    """What stands for the value in the help; by default its type."""
    positional: bool = False
    """Whether it is an argument without a dash."""
