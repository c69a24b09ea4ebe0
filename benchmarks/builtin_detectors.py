"""How well the built-in detectors find cars in freshly rendered scenes, by paint.

    python benchmarks/builtin_detectors.py --out out/builtin_detectors
    python benchmarks/builtin_detectors.py --frames ../shared/data/streets --held-out Town04

The scenes are drawn as those of ``cnca train-detector`` are, by another seed: more of them than the
15 % that a training leaves out for its own test.  The same command goes on after an interruption.
With ``--frames`` they are labelled frames instead, those of the groups that are held out; there
``--detector FILE`` adds others, of which every vehicle counts as a car.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from tables import markdown

from cnca.core.manifest import write_json
from cnca.core.types import Detections, SrgbImages
from cnca.detect import BUILTINS, load_detector
from cnca.judge.scores import as_one_class
from cnca.train.detector.accuracy import measure
from cnca.train.detector.dataset import TEST, LabelledPictures
from cnca.train.detector.frames import gather_frames
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
    parser.add_argument("--frames", type=Path)
    parser.add_argument("--held-out", action="append", default=[])
    parser.add_argument("--detector", action="append", default=[])
    options = parser.parse_args()
    if options.frames:
        gather_frames(options.frames, options.out / "frames", held_out=options.held_out)
        data = LabelledPictures(options.out / "frames")
        names = [*BUILTINS, *options.detector]
        report(options.out / "frames.json", {n: measure(Vehicles(n), data) for n in names})
        return
    folder = options.out / "pictures"
    cast = replace(BUILTIN_CAST, groups=GROUPS)
    render_detector_data(folder, pictures=options.pictures, seed=options.seed, cast=cast)
    data = LabelledPictures(folder)
    data.split = [TEST] * len(data.pictures)
    report(
        options.out / "report.json", {name: measure(load_detector(name), data) for name in BUILTINS}
    )


class Vehicles:
    """A detector whose cars, trucks and buses are all class 0."""

    class_names = ("car",)

    def __init__(self, name: str) -> None:
        self._detector = load_detector(name)

    def detect(self, images: SrgbImages, *, score_threshold: float) -> list[Detections]:
        """Detections of vehicles alone."""
        names = self._detector.class_names
        vehicles = [k for k, name in enumerate(names) if name in ("car", "truck", "bus")]
        found = self._detector.detect(images, score_threshold=score_threshold)
        return [as_one_class(detections, vehicles) for detections in found]


def report(path: Path, measured: dict[str, dict[str, dict[str, float]]]) -> None:
    """Write the numbers of each detector and group as JSON, and print them."""
    write_json(path, measured)
    rows = [
        [name, paint, *cells(numbers)]
        for name, by_paint in measured.items()
        for paint, numbers in by_paint.items()
    ]
    print("\n".join(markdown(HEADINGS, rows)))


if __name__ == "__main__":
    main()
