"""What the benchmarks of speed have in common: costs taken in turn, goals, and their file."""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from cnca.manifest import versions, write_json

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


def report(out: Path, name: str, measured: Mapping[str, Any], goals: list[Goal]) -> None:
    """Print the results as JSON and keep them in ``out/NAME.json``."""
    content = {
        "benchmark": name,
        "versions": versions() | {"cores": os.cpu_count()},
        "measured": measured,
        "goals": [asdict(goal) | {"met": goal.met} for goal in goals],
    }
    print(json.dumps(content, indent=2))
    write_json(out / f"{name}.json", content)


def markdown(corner: str, rows: Mapping[str, Mapping[str, Any]]) -> str:
    """Rows with the same columns as a table."""
    columns = list(next(iter(rows.values())))
    lines = [f"| {corner} | " + " | ".join(columns) + " |", "|---" * (1 + len(columns)) + "|"]
    for name, row in rows.items():
        lines.append(f"| {name} | " + " | ".join(f"{row[column]}" for column in columns) + " |")
    return "\n".join(lines)


def parser(description: str | None) -> argparse.ArgumentParser:
    """A command line with the folder of the results."""
    arguments = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    arguments.add_argument("--out", type=Path, default=Path("out/bench"))
    return arguments
