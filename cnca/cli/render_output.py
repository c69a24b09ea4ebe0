"""What rendering says: where the pictures are, the plan, and the price lists."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table


def show_renders(
    folder: Path, records: list[dict[str, Any]], *, explain: bool, as_json: bool
) -> None:
    """Print where the pictures are, or the records themselves."""
    if as_json:
        print(json.dumps(records, indent=2))
        return
    console = Console()
    if explain:
        console.print(_plan_table(records[0]["plan"]))
    for record in records:
        seconds = record["seconds"]
        console.print(
            f"{folder / record['picture']}: first call {seconds['first']:.2f} s, "
            f"steady {seconds['steady']:.2f} s",
            soft_wrap=True,
        )


def _plan_table(plan: list[dict[str, Any]]) -> Table:
    """The plan; error and share of the time are predictions."""
    table = Table()
    for name in ("effect", "model", "why", "error", "time"):
        table.add_column(name, no_wrap=name != "why")
    for row in plan:
        numbers = f"{row['error']:.2%}", f"{row['time_share']:.0%}"
        table.add_row(row["effect"], str(row["model"]), row["why"], *numbers)
    return table


def accuracy(scene: Path, out: Path, **options: Any) -> None:
    """Measure the price list with progress, then say how good its reference is."""
    from cnca.jobs.accuracy.ladder import accuracy as measure  # loads colour-science, which is slow
    from cnca.jobs.accuracy.price_list import describe_reference

    report, shown = measure(scene, out, console=Console(stderr=True), **options), Console()
    shown.print(describe_reference(report["reference"]), soft_wrap=True)
    for rung in report["rungs"]:
        if rung["target"] is not None:
            spent = rung["seconds"]["steady"]["forward"]
            shown.print(
                f"{rung['name']}: error {rung['error']:.2%} in {spent:.2f} processor seconds"
            )
    for ending in ("md", "png", "json"):
        shown.print(out / f"accuracy.{ending}", soft_wrap=True)


def generator_accuracy(out: Path, **options: Any) -> None:
    """Measure the generator's price list with progress, then print it."""
    from cnca.jobs.accuracy.generator import generator_accuracy as measure

    report, shown = measure(out, console=Console(stderr=True), **options), Console()
    listed = Table("last steps", "seconds", "cosine", "length")
    for row in report["prices"]:
        numbers = f"{row['seconds']:.2f}", f"{row['cosine']:.3f}", f"{row['length']:.3f}"
        listed.add_row(str(row["steps"]), *numbers)
    shown.print(listed)
    for ending in ("md", "png", "json"):
        shown.print(out / f"generator.{ending}", soft_wrap=True)
