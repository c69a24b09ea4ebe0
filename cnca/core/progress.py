"""How long work shows itself: bar, count, rate, remaining time."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from typing import TypeVar

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

Item = TypeVar("Item")


class RateColumn(ProgressColumn):
    """Seconds per step, or steps per second where they are quick."""

    def render(self, task: Task) -> Text:
        """``–`` until the first step has ended."""
        if not task.speed:
            return Text("–", style="dim")
        quick = task.speed > 1
        text = f"{task.speed:.1f} per second" if quick else f"{1 / task.speed:.1f} s each"
        return Text(text, style="dim")


def bar(console: Console | None = None) -> Progress:
    """A progress bar on ``console``, or stderr; none with ``cnca --quiet`` or CNCA_QUIET=1."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        RateColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console or Console(stderr=True),
        disable=os.environ.get("CNCA_QUIET", "0") not in ("", "0"),
    )


def track(items: Sequence[Item], label: str) -> Iterator[Item]:
    """The items one by one, with a bar."""
    with bar() as shown:
        yield from shown.track(items, description=label)
