"""The ``cnca`` command.  Commands import what they need inside, so that ``--help`` is instant."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from cnca import __version__
from cnca.errors import CncaError

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


@app.command()
def doctor(
    json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,
) -> None:
    """Check LLVM, Mitsuba and the other packages, and render a test picture."""
    from cnca.doctor import diagnose

    report = diagnose()
    typer.echo(report.as_json() if json else "\n".join(report.lines()))
    raise typer.Exit(0 if report.healthy else 1)


def main() -> None:
    """Run the command line; bad input ends with one line on stderr and exit code 2."""
    try:
        app(prog_name="cnca")
    except Exception as error:
        message = _user_message(error)
        if message is None:
            raise
        print(f"error: {message}", file=sys.stderr)
        raise SystemExit(2) from None


def _user_message(error: Exception) -> str | None:
    """The one line to show for ``error``, or None if it is a bug that deserves its traceback."""
    if isinstance(error, CncaError):
        return " ".join(str(error).split())
    pydantic = sys.modules.get("pydantic")  # who has not imported it cannot have raised its error
    if pydantic is not None and isinstance(error, pydantic.ValidationError):
        places = (
            f"{'.'.join(map(str, one['loc']))}: {one['msg']}, got {one['input']!r}"
            for one in error.errors()
        )
        return f"{error.title}: " + "; ".join(places)
    return None
