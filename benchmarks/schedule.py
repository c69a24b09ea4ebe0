"""How many views runs of the attack looked at, beside the paper's schedule.

    python benchmarks/schedule.py out/sedan out/etron --document docs/speed.md

views       steps × views of a step
of 204,800  their share of the paper's 5 epochs × 40,960 pictures
to 3/4 …    views after which the score of the steps, their mean over one round of all weathers, has
            fallen to that share of the prompt texture's (F_adv = 0, held-out views); "never" where
            the run did not come so far
score, AP   of held-out views: the prompt's texture → the camouflage
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from stopwatch import named_rows, parser, report

from cnca.attack.settings import WEATHERS
from cnca.core.manifest import read_json

PAPER = 5 * 40_960
SHARES = {"3/4": 0.75, "1/2": 0.5, "1/4": 0.25}


def row(run: Path) -> dict[str, int | str]:
    """The columns of a finished run."""
    summary, request = (read_json(run / f"{name}.json") for name in ("summary", "manifest"))
    each = request["request"]["settings"]["views_per_step"]
    lines = (run / "log.jsonl").read_text(encoding="utf-8").splitlines()
    scores = np.array([json.loads(line)["D_s"] for line in lines])
    rounds = np.convolve(scores, np.full(WEATHERS, 1 / WEATHERS), "valid")
    views = each * len(scores)
    columns: dict[str, int | str] = {}
    for name, share in SHARES.items():
        reached = np.flatnonzero(rounds <= share * summary["score_prompt"])
        columns[f"to {name}"] = each * int(reached[0] + WEATHERS) if len(reached) else "never"
    aps = summary["AP@0.5"]
    return {
        "views": views,
        f"of {PAPER:,}": f"{views / PAPER:.1%}",
        **columns,
        "score": f"{summary['score_prompt']:.2f} → {summary['score_after']:.2f}",
        "AP@0.5": f"{aps['prompt']:.2f} → {aps['after']:.2f}",
    }


def main() -> None:
    """Read the runs."""
    arguments = parser(__doc__)
    arguments.add_argument("runs", nargs="+", type=Path, help="folders of cnca optimize")
    options = arguments.parse_args()
    rows = {str(run): row(run) for run in options.runs}
    report(options, "schedule", rows, [], [named_rows("run", rows)])


if __name__ == "__main__":
    main()
