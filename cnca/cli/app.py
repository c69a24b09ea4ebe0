"""The application that the commands register with."""

from __future__ import annotations

from typing import Annotated

import typer

from cnca import __version__

app = typer.Typer(
    name="cnca",
    help="Customizable, natural adversarial camouflage: how robust is a vehicle detector?",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"cnca {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version and exit."
        ),
    ] = False,
) -> None:
    pass
