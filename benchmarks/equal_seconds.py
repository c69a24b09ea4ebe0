"""The attack by each backend with the same processor seconds, judged by the path tracer.

    python benchmarks/equal_seconds.py scenes/sedan_clear.yaml --seconds 60 \
      --efr raster=builtin --efr mitsuba=out/efr/mitsuba.safetensors

takes the backends of ``backends.py`` and searches free texels in place of F_adv, as
``benchmarks/texels.py`` does: the shipped generator costs most of a step, whichever backend draws.
What a backend prepares, and the kernels that it compiles, count.  The same command goes on after an
interruption; it writes the table of docs/backends.md.
"""

from __future__ import annotations

import argparse
import shlex
import sys
import time
from contextlib import suppress
from pathlib import Path

import torch
from backends import Row, corrected, read_residuals
from tables import markdown, put
from texels import BOUND, SIZE, Texels

from cnca import build
from cnca.attack.loop import Attack, Progress, Settings, optimize, start
from cnca.attack.objectives import paper
from cnca.attack.records import StepRecord
from cnca.core.images import write_texture_srgb
from cnca.core.manifest import read_json, write_json
from cnca.core.types import SrgbTexture
from cnca.judge.bootstrap import Sampled, resample
from cnca.judge.evaluate import evaluate
from cnca.judge.held_out import held_out_shots
from cnca.judge.truth import Truth
from cnca.judge.verdict import Measured, Seen, measure, word_for
from cnca.scene import controls
from cnca.scene.load_scene import load_scene
from cnca.scene.protocols import Residual

SIDE, VIEWS_HELD_OUT = 24, 24
"""Texels a side, and views that judge."""
OBJECTIVE = paper.Loss(full_overlap=0.5)
ENDLESS = 10**6
"""Steps: the time is up before."""


DEFAULT = "mitsuba, 16 spp"
"""The loop as ``cnca optimize`` has it, with which all others are compared."""
HEADINGS = ("backend", "steps", "score", "AP@0.5", f"score less that of {DEFAULT}")


class TimeUp(Exception):
    """The processor seconds are spent."""


class Contest:
    """One scene and one detector for all backends."""

    def __init__(self, scene: Path, detector: str, seconds: float) -> None:
        self.scene, self.seconds = load_scene(scene), seconds
        self.targets = build.build_targets([detector])
        self.vehicle = build.build_vehicle(self.scene)
        self.paint = build.build_paint(self.scene, self.vehicle)

    def search(self, row: Row, residual: Residual | None) -> tuple[SrgbTexture, int]:
        """The texture that one backend finds, and in how many steps."""
        deadline, parts = time.process_time() + self.seconds, (self.scene, self.vehicle, self.paint)
        loop = build.build_loop_renderer(*parts, backend=row.backend, samples=row.samples)
        attack = Attack(
            self.scene, loop, self.paint, Texels(SIDE), self.targets, OBJECTIVE, residual
        )
        settings = Settings(
            "",
            tau=BOUND,
            steps=ENDLESS,
            views_per_step=2,
            view_pool=1,
            learning_rate=0.3,
            start_spread=0.5,
        )
        progress = start(attack, settings)

        def after_step(progress: Progress, record: StepRecord) -> None:
            if time.process_time() > deadline:
                raise TimeUp

        with suppress(TimeUp):
            optimize(attack, settings, progress, after_step)
        return attack.texture(torch.zeros(0), progress.variables.latents, 0).detach(), progress.step

    def judge(self, textures: dict[str, SrgbTexture]) -> dict[str, Measured]:
        """How the detector sees each of them on the path tracer's held-out views."""
        target = self.targets[0]
        albedos = {name: self.paint.apply(texture) for name, texture in textures.items()}
        renderer = build.build_renderer(self.scene, self.vehicle)
        shots = held_out_shots(self.scene, VIEWS_HELD_OUT, 0)
        weights = resample([VIEWS_HELD_OUT], seed=0)
        results = evaluate(renderer, self.targets, albedos, shots)[target.name]
        names = target.detector.class_names
        return {
            name: measure(Seen(r.detections, names), None, Truth(r.boxes), weights, "car")
            for name, r in results.items()
        }


def found(
    contest: Contest, row: Row, residual: Residual | None, out: Path
) -> tuple[SrgbTexture, int]:
    """What one backend found, now or before."""
    kept = out / f"{row.name.replace(' ', '_')}.json"
    picture = kept.with_suffix(".png")
    if not kept.exists():
        texture, steps = contest.search(row, residual)
        write_texture_srgb(picture, texture.permute(1, 2, 0).numpy())
        write_json(kept, {"steps": steps})
    return build.read_texture(picture), read_json(kept)["steps"]


def shown(number: Sampled) -> str:
    """A number with its 95 % interval over views."""
    low, high = number.interval()
    return f"{number.value:.2f} [{low:.2f}, {high:.2f}]"


def main() -> None:
    """Search what is not there, judge all, then write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--seconds", type=float, default=60, help="Processor seconds of each.")
    parser.add_argument("--efr", action="append", default=[], help="BACKEND=PATH; repeatable")
    parser.add_argument("--detector", default="builtin")
    parser.add_argument("--out", type=Path, default=Path("out/equal_seconds"))
    parser.add_argument("--document", type=Path, default=Path("docs/backends.md"))
    options = parser.parse_args()
    contest = Contest(options.scene, options.detector, options.seconds)
    steps: dict[str, int] = {}
    textures: dict[str, SrgbTexture] = {}
    for row, residual in corrected(read_residuals(options.efr)):
        textures[row.name], steps[row.name] = found(contest, row, residual, options.out)
        print(row.name, steps[row.name], flush=True)
    textures["plain paint"] = contest.paint.base
    textures["random blocks"] = controls.random_blocks(SIZE, torch.Generator().manual_seed(0))
    judged, lines = contest.judge(textures), []
    for name, own in judged.items():
        less = own["score"] - judged[DEFAULT]["score"]
        compared = "–" if name == DEFAULT else f"{shown(less)}, {word_for(less, VIEWS_HELD_OUT)}"
        count = str(steps.get(name, "–"))
        lines.append([name, count, shown(own["score"]), shown(own["AP_voc"]), compared])
    command = f"python {shlex.join(sys.argv)}"
    table = ["```sh", command, "```", "", *markdown(HEADINGS, lines)]
    put(options.document, "equal seconds", table)


if __name__ == "__main__":
    main()
