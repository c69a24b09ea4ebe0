"""What is moved against what is lowered: AP@0.5 and prompt score over seeds and prompts.

    python benchmarks/objectives.py --scene scenes/etron_clear.yaml \
      --detector ../shared/detectors/yolo-fastest-1.1-xl.cfg --out out/objectives \
      --document docs/attack.md

Every cell is a whole attack in a folder of its own below ``--out``; a rerun reads those that are
there, goes on with one that was interrupted, and makes the table of what is finished.  Intervals
are 95 %, Student's t over all runs of a row; a row of one run has none.
"""

from __future__ import annotations

import argparse
import statistics
from dataclasses import replace
from itertools import product
from pathlib import Path

from rich.console import Console
from scipy import stats
from tables import markdown, put

from cnca.attack.settings import VARIABLES, Settings
from cnca.gen.scorer import load_scorer
from cnca.gen.textures import PAPER_PROMPTS
from cnca.jobs.attack.presets import under_preset
from cnca.jobs.attack.request import Request
from cnca.jobs.attack.runs import Row, row

NAME = "objectives"
HEADINGS = (
    "moved",
    "lowered",
    "runs",
    "AP@0.5",
    "its mask-aware shuffle",
    "detection score",
    "prompt score",
)


def interval(values: list[float]) -> str:
    """Mean and half the width of its 95 % interval."""
    mean = statistics.mean(values)
    if len(values) < 2:
        return f"{mean:.3f}"
    error = statistics.stdev(values) / len(values) ** 0.5
    return f"{mean:.3f} ± {stats.t.ppf(0.975, len(values) - 1) * error:.3f}"


def cells(variable: str, objective: str, rows: list[Row]) -> list[str]:
    """A row of the table."""
    attacked, cut = (
        [one.summary.average_precision[name] for one in rows] for name in ("after", "shuffled")
    )
    return [
        variable,
        objective,
        str(len(rows)),
        interval(attacked),
        interval(cut),
        interval([one.detection_score for one in rows]),
        interval([one.naturalness.prompt_score for one in rows]),
    ]


parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--scene", type=Path, required=True)
parser.add_argument("--detector", action="append", required=True)
parser.add_argument("--out", type=Path, required=True)
parser.add_argument("--variables", nargs="+", default=["noise", "feature"], choices=VARIABLES)
parser.add_argument("--objectives", nargs="+", default=["odds", "logit", "paper"])
parser.add_argument("--prompts", nargs="+", default=list(PAPER_PROMPTS[-3:]))
parser.add_argument("--seeds", type=int, default=3)
parser.add_argument("--steps", type=int, default=45)
parser.add_argument("--views", type=int, default=48, help="held-out views")
parser.add_argument("--document", type=Path)
arguments = parser.parse_args()

console, scorer = Console(stderr=True), load_scorer()
finished: dict[tuple[str, str], list[Row]] = {}
for seed, prompt in product(range(arguments.seeds), arguments.prompts):
    for variable, objective in product(arguments.variables, arguments.objectives):
        folder = arguments.out / "_".join([variable, objective, *prompt.split(), str(seed)])
        settings = Settings(prompt, steps=arguments.steps, seed=seed)
        asked = under_preset(Request(arguments.scene, folder, settings), but=["minutes"])
        asked = replace(
            asked,
            settings=replace(asked.settings, variable=variable),
            objective=objective,
            detectors=tuple(arguments.detector),
            held_out_views=arguments.views,
            gradient_checkpointing=False,
        )
        label = f"{variable}, {objective}, {prompt}, seed {seed}"
        finished.setdefault((variable, objective), []).append(row(asked, label, scorer, console))
    lines = markdown(HEADINGS, [cells(*pair, rows) for pair, rows in finished.items()])
    print("\n".join(lines), flush=True)
    if arguments.document:
        put(arguments.document, NAME, lines)
