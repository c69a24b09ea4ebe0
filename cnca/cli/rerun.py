"""The command that repeats a run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cnca.cli.app import app
from cnca.cli.help import ATTACK


@app.command(rich_help_panel=ATTACK)
def rerun(
    manifest: Annotated[Path, typer.Argument(help="manifest.json of a run.")],
    out: Annotated[Path, typer.Option(help="Folder of the new run.")],
) -> None:
    """Repeat a run from its manifest, and say whether its texture came out the same."""
    from rich.console import Console

    from cnca.jobs.attack.rerun import rerun

    again = rerun(manifest, out, Console(stderr=True))
    for name, (was, now) in again.other_versions.items():
        typer.echo(f"{name}: was {was}, is {now}")
    if again.difference is not None:
        same = "the same to the bit"
        apart = f"differs by up to {again.difference * 255:.0f} of 255"
        typer.echo(f"texture: {apart if again.difference else same}")
    typer.echo(again.out / "texture.png")
