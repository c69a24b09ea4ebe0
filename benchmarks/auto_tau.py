"""τ found by bisection beside that of an exhaustive sweep.

    python benchmarks/auto_tau.py out/auto_tau/*

reads sweeps of ``cnca tradeoff`` over the whole of ``auto_tau.GRID`` and prints, for each prompt
and each prompt score asked for, the bound that ``--tau auto`` takes (it makes the same runs), the
strongest of the whole sweep that keeps the score, and how many places of the grid lie between.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from tables import markdown

from cnca.core.errors import RunError
from cnca.core.manifest import read_json
from cnca.jobs.attack.auto_tau import GRID, bisect, strongest
from cnca.jobs.attack.runs import tau_folder

HEADINGS = (
    "prompt",
    "prompt score asked",
    "runs",
    "τ by bisection",
    "by the sweep",
    "places apart",
)


def swept(sweep: Path) -> dict[float, tuple[float, float]]:
    """τ → prompt score, detection score; raises RunError where a bound of the grid is missing."""
    rows = {row["folder"]: row for row in read_json(sweep / "tradeoff.json")["rows"]}
    missing = [f"{tau:g}" for tau in GRID if tau_folder(tau) not in rows]
    if missing:
        raise RunError(
            f"{sweep}: lacks τ = {', '.join(missing)}; run cnca tradeoff over all of them"
        )
    ours = {tau: rows[tau_folder(tau)] for tau in GRID}
    return {tau: (row["prompt_score"], row["score"]) for tau, row in ours.items()}


def compare(found: dict[float, tuple[float, float]], least: float) -> list[str]:
    """The cells behind prompt and score asked; – where no bound keeps it."""
    tried: dict[float, tuple[float, float]] = {}

    def keeps(tau: float) -> bool:
        tried[tau] = found[tau]
        return found[tau][0] >= least

    bisect(GRID, keeps)
    chosen, best = strongest(tried, least), strongest(found, least)
    if chosen is None or best is None:
        return [
            str(len(tried)),
            *("–" if tau is None else f"{tau:g}" for tau in (chosen, best)),
            "–",
        ]
    apart = abs(GRID.index(chosen) - GRID.index(best))
    return [str(len(tried)), f"{chosen:g}", f"{best:g}", str(apart)]


def main() -> None:
    """Print the table of all sweeps."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sweep", type=Path, nargs="+")
    parser.add_argument("--score", type=float, nargs="+", default=[0.5, 0.6, 0.7])
    options = parser.parse_args()
    rows = []
    for sweep in options.sweep:
        found = swept(sweep)
        for least in options.score:
            rows.append([sweep.name.replace("_", " "), f"{least:g}", *compare(found, least)])
    print("\n".join(markdown(HEADINGS, rows)))


if __name__ == "__main__":
    main()
