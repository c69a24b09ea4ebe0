"""How well the built-in detectors find cars in freshly rendered scenes, by paint.

    python benchmarks/builtin_detectors.py --out out/builtin_detectors

The scenes are drawn as those of ``cnca train-detector`` are, by another seed: more of them than the
15 % that a training leaves out for its own test.  The same command goes on after an interruption.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from tables import markdown

from cnca.core.manifest import write_json
from cnca.detect import BUILTINS, load_detector
from cnca.train.detector.accuracy import measure
from cnca.train.detector.dataset import TEST, LabelledPictures
from cnca.train.detector.renders import BUILTIN_CAST, GROUPS, render_detector_data

HEADINGS = ("detector", "paint", "pictures", "AP@0.5", "found at 0.25", "false alarms")


def cells(numbers: dict[str, float]) -> list[str]:
    """Pictures and the three shares, – where there is none."""
    names = "ap50", "found", "false_alarms"
    shares = (f"{numbers[name]:.2f}" if name in numbers else "–" for name in names)
    return [str(numbers["pictures"]), *shares]


def main() -> None:
    """Render, measure, print a table and write it as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pictures", type=int, default=900)
    parser.add_argument("--seed", type=int, default=1007, help="None that a training took.")
    parser.add_argument("--out", type=Path, default=Path("out/builtin_detectors"))
    options = parser.parse_args()
    folder = options.out / "pictures"
    cast = replace(BUILTIN_CAST, groups=GROUPS)
    render_detector_data(folder, pictures=options.pictures, seed=options.seed, cast=cast)
    data = LabelledPictures(folder)
    data.split = [TEST] * len(data.pictures)
    report = {name: measure(load_detector(name), data) for name in BUILTINS}
    write_json(options.out / "report.json", report)
    rows = [
        [name, paint, *cells(numbers)]
        for name, by_paint in report.items()
        for paint, numbers in by_paint.items()
    ]
    print("\n".join(markdown(HEADINGS, rows)))


if __name__ == "__main__":
    main()
