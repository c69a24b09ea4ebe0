"""What the benchmarks of speed have in common: costs taken in turn, goals, and their file."""

from __future__ import annotations

import argparse
import json
import os
import shlex
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from tables import markdown, put

from cnca.core.manifest import versions, write_json

Found = TypeVar("Found")


@dataclass(frozen=True)
class Cost:
    """Medians of a call."""

    cpu: float
    """Processor seconds of all threads: what else runs on the machine hardly changes them."""
    wall: float
    """Seconds on the clock."""


@dataclass(frozen=True)
class Goal:
    """A number that was aimed at."""

    what: str
    measured: float
    bound: float
    at_least: bool = False

    @property
    def met(self) -> bool:
        """Whether the number is on the right side of the bound."""
        good = self.measured >= self.bound if self.at_least else self.measured <= self.bound
        return bool(good)


def in_turn(
    calls: Mapping[str, Callable[[int], Found]], turns: int
) -> tuple[dict[str, Cost], dict[str, list[Found]]]:
    """Costs and results of the calls, made one after the other in each turn.

    Each is given the number of the turn, its seed; turn 0, in which kernels are made, is left out.
    """
    seconds: dict[str, list[tuple[float, float]]] = {name: [] for name in calls}
    found: dict[str, list[Found]] = {name: [] for name in calls}
    for turn in range(turns + 1):
        for name, call in calls.items():
            cpu, wall = time.process_time(), time.perf_counter()
            result = call(turn)
            spent = time.process_time() - cpu, time.perf_counter() - wall
            if turn > 0:
                seconds[name].append(spent)
                found[name].append(result)
    costs = {name: Cost(*np.median(spent, axis=0).tolist()) for name, spent in seconds.items()}
    return costs, found


def report(
    options: argparse.Namespace,
    name: str,
    measured: Mapping[str, object],
    goals: Sequence[Goal],
    tables: Sequence[Sequence[str]],
) -> None:
    """Print the results as JSON, keep them in ``OUT/NAME.json``, and show them in the document."""
    content = {
        "benchmark": name,
        "versions": versions() | {"cores": os.cpu_count()},
        "measured": measured,
        "goals": [asdict(goal) | {"met": goal.met} for goal in goals],
    }
    print(json.dumps(content, indent=2))
    write_json(options.out / f"{name}.json", content)
    if options.document:
        command = shlex.join([f"benchmarks/{name}.py", *sys.argv[1:]])
        lines = ["```sh", f"python {command}", "```"]
        for table in filter(None, (*tables, goals_table(goals))):
            lines += ["", *table]
        put(options.document, name, lines)


def goals_table(goals: Sequence[Goal]) -> list[str]:
    """What was aimed at and what was measured, as the lines of a table."""
    rows = {
        goal.what: {
            "measured": f"{goal.measured:g}",
            "bound": f"{'≥' if goal.at_least else '≤'} {goal.bound:g}",
            "met": "yes" if goal.met else "**no**",
        }
        for goal in goals
    }
    return named_rows("goal", rows) if rows else []


def named_rows(corner: str, rows: Mapping[str, Mapping[str, object]]) -> list[str]:
    """Rows with the same columns as the lines of a table."""
    columns = list(next(iter(rows.values())))
    cells = [[name, *(f"{row[column]}" for column in columns)] for name, row in rows.items()]
    return markdown([corner, *columns], cells)


def parser(description: str | None) -> argparse.ArgumentParser:
    """A command line with the folder of the results, and the document that shows them."""
    arguments = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    arguments.add_argument("--out", type=Path, default=Path("out/bench"))
    arguments.add_argument("--document", type=Path, help="put the tables there: docs/speed.md")
    return arguments
