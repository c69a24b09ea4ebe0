"""The tables of docs/evidence.md: two camouflages before five detectors, in clear sun and in fog.

    python benchmarks/evidence.py --run sedan=out/sedan --run etron=out/etron \
      --detector builtin --detector builtin:anchor-free --detector builtin:transformer \
      --detector ../shared/detectors/yolo-fastest-1.1-xl.cfg \
      --detector ../shared/detectors/yolox_nano.onnx

evaluates each run in scenes/NAME_clear.yaml and scenes/NAME_fog.yaml, below ``--out``, where
a rerun finds its pictures.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from tables import put

from cnca.jobs.evaluate.evaluation import evaluate_scenes
from cnca.jobs.evaluate.request import EvaluationRequest
from cnca.judge.candidates import named
from cnca.judge.records import Evidence
from cnca.report.tables import by_detector, by_measure, comparison_table

SHUFFLED = "cnca shuffled"
"""The control that a camouflage has to beat first: its own palette."""


def tables(results: Evidence) -> list[str]:
    """AP by detector, all measures in total, and the differences from the shuffled control."""
    shuffled = [found for found in results.comparisons if found.control == SHUFFLED]
    return [
        "AP@0.5 of the car (Pascal VOC 2010–2012):\n",
        by_detector(results.all, "car", results),
        "Mean over the detectors:\n",
        by_measure(results),
        "Difference from the shuffled control, over the same views:\n",
        comparison_table(replace(results, comparisons=shuffled)).rstrip(),
    ]


def main() -> None:
    """Evaluate each run and write its tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--run", action="append", required=True, metavar="NAME=FOLDER")
    parser.add_argument("--detector", action="append", required=True)
    parser.add_argument("--views", type=int, default=48, help="Of each scene.")
    parser.add_argument("--out", type=Path, default=Path("out/tables"))
    parser.add_argument("--document", type=Path, default=Path("docs/evidence.md"))
    options = parser.parse_args()
    for name, folder in map(named, options.run):
        results = evaluate_scenes(
            EvaluationRequest(
                scenes=tuple(Path(f"scenes/{name}_{weather}.yaml") for weather in ("clear", "fog")),
                out=options.out / name,
                textures=(f"cnca={folder}",),
                detectors=tuple(options.detector),
                views=options.views,
            ),
            Console(stderr=True),
        )
        put(options.document, name, tables(results))
    put(options.document, "command", ["```sh", f"python {shlex.join(sys.argv)}", "```"])


if __name__ == "__main__":
    main()
