"""What a field of a record says to people who fill it: the command line makes a flag of it.

A record writes ``steps: Annotated[int, Flag("Updates of F_adv.", STRENGTH)] = 100``; its name, type
and default are the flag's.  :mod:`cnca.cli.options` reads it, and nothing here knows of it.
"""

from __future__ import annotations

from dataclasses import dataclass

from cnca.core.errors import RunError

WHAT, STRENGTH, COST, OUTPUT = "What", "Strength", "Cost", "Output"
PANELS = (WHAT, STRENGTH, COST, OUTPUT)
"""Parts of a command's help, in this order: what is worked on, how strongly, what it costs in time
and memory, and where the results go."""

FIGURE_FORMAT = "CNCA_FIGURE_FORMAT"
"""Environment variable with the formats of plots; ``--figure-format`` sets it."""
FIGURE_FORMATS = (".pdf", ".svg")
"""Formats in which plots can be written beside PNG."""


def figure_formats(words: str) -> list[str]:
    """Endings for words such as ``pdf,svg``; PNG is always written and is none of them.

    Raises RunError for another format.
    """
    endings = [f".{word.strip().lower()}" for word in words.split(",") if word.strip()]
    for ending in endings:
        if ending not in (".png", *FIGURE_FORMATS):
            raise RunError(f"--figure-format {words}: plots are written as png, pdf or svg")
    return [ending for ending in FIGURE_FORMATS if ending in endings]


@dataclass(frozen=True)
class Flag:
    """One flag of the command line; a field without one is not asked for."""

    help: str
    panel: str = WHAT
    """One of :data:`PANELS`."""
    name: str | None = None
    """With underscores, where it differs from the field's: ``spp`` for ``samples``."""
    short: str | None = None
    """One letter that does as well: ``o`` for ``-o``."""
    metavar: str | None = None
    """What stands for the value in the help; by default its type."""
    positional: bool = False
    """Whether it is an argument without a dash."""
