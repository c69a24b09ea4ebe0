"""The application that the commands register with."""

from __future__ import annotations

import os
from typing import Annotated

import typer

from cnca.cli.help import Group
from cnca.core.errors import RunError
from cnca.core.options import FIGURE_FORMAT, figure_formats

QUIET = "CNCA_QUIET"
"""Environment variable that silences progress bars; ``--quiet`` sets it."""
MEMORY_BUDGET = "CNCA_MEMORY_BUDGET"
"""Environment variable that bounds the memory of rays; ``--memory-budget`` sets it."""

LAUNCHED = "TORCHELASTIC_RUN_ID"
"""Environment variable by which ``cnca.core.parallel`` knows torchrun."""
DIVIDED = ("optimize", "evaluate", "render-dataset", "train-efr")
"""Commands whose work torchrun's processes divide."""

app = typer.Typer(
    name="cnca",
    cls=Group,
    help="Customizable, natural adversarial camouflage: how robust is a vehicle detector?",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from cnca.core.manifest import versions
        from cnca.mi_bridge import llvm

        library = llvm.first_by_name()
        every = versions() | {"LLVM": library.name if library else "missing"}
        typer.echo("\n".join(f"{name} {version}" for name, version in every.items()))
        raise typer.Exit


@app.callback()
def _options(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            callback=_print_version,
            is_eager=True,
            help="Print all versions that matter.",
        ),
    ] = False,
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", envvar=QUIET, help="No progress bars.")
    ] = False,
    memory_budget: Annotated[
        str | None,
        typer.Option(
            metavar="SIZE",
            envvar=MEMORY_BUDGET,
            help="Memory for rays, such as 500MiB: larger pictures are rendered in parts.",
        ),
    ] = None,
    figure_format: Annotated[
        str,
        typer.Option(
            metavar="FORMATS",
            envvar=FIGURE_FORMAT,
            help="Write plots as pdf or svg, too, for papers; or pdf,svg.",
        ),
    ] = "png",
) -> None:
    command = context.invoked_subcommand
    if LAUNCHED in os.environ and command not in DIVIDED:
        raise RunError(
            f"cnca {command} under torchrun: each process would do all of it; start it alone, "
            f"torchrun divides {', '.join(DIVIDED)}"
        )
    if figure_formats(figure_format):
        os.environ[FIGURE_FORMAT] = figure_format  # where cnca.report.figures looks
    if memory_budget:
        os.environ[MEMORY_BUDGET] = memory_budget  # likewise in cnca.mi_bridge.memory
    if quiet:
        os.environ[QUIET] = "1"  # where cnca.core.progress looks, in this process and its children
