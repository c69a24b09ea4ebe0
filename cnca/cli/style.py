"""``cnca judge-style``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cnca.cli.app import app
from cnca.cli.help import JUDGE


@app.command("judge-style", rich_help_panel=JUDGE)
def judge_style(
    texture: Annotated[
        list[str], typer.Argument(help="As for evaluate, [NAME=]PATH: a picture or a run's folder.")
    ],
    prompt: Annotated[
        list[str] | None,
        typer.Option("--prompt", "--prompts", help="To choose among; by default ten. Repeatable."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="JSON file with all shares.")] = None,
) -> None:
    """Say which of ten prompts a texture shows, by a judge that is in no loss."""
    from rich.console import Console
    from rich.table import Table

    from cnca.jobs.judge_style import judge_style as judge
    from cnca.judge.style import TEN_PROMPTS

    verdicts = judge(texture, prompts=prompt or TEN_PROMPTS, out=out)
    table = Table("texture", "asked for", "shows", "share", "next", "share")
    for verdict in verdicts:
        first, second = ((name, f"{share:.2f}") for name, share in verdict.ranked[:2])
        table.add_row(verdict.texture, verdict.asked or "–", *first, *second)
    Console().print(table)
    known = [verdict.right for verdict in verdicts if verdict.right is not None]
    if known:
        typer.echo(f"the prompt that was asked for: {sum(known)} of {len(known)} textures")
