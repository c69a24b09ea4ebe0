"""``cnca optimize`` as a process of its own, small enough to be started many times."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from safetensors import safe_open

from tests.gen.tiny import save_pipeline, tiny_pipeline

SCENE = """
vehicle: {mesh: builtin:sedan, texture_size: 64}
variation: {distance: [6, 7], elevation: [10, 20]}
image: {width: 64, height: 64, samples: 2}
"""


class AttackProcess:
    """Starts attacks on one scene and one generator below ``folder``."""

    def __init__(self, folder: Path, *, steps: int):
        self.scene = folder / "scene.yaml"
        self.scene.write_text(SCENE)
        self.generator = save_pipeline(tiny_pipeline(), folder / "generator")
        self.steps = steps

    def command(self, out: Path, *more: str) -> list[str]:
        options = {
            "scene": self.scene,
            "generator": self.generator,
            "out": out,
            "prompt": "zebra strips",
            "preset": "paper",
            "steps": self.steps,
            "views-per-step": 1,
            "spp": 2,
            "learning-rate": 0.1,
            "gradient-steps": 2,
            "held-out-views": 4,
        }
        words = [word for name, value in options.items() for word in (f"--{name}", str(value))]
        return [sys.executable, "-m", "cnca", "optimize", *words, *more]

    def start(
        self, out: Path, *more: str, first: Callable[[], None] = lambda: None, **environment: str
    ) -> subprocess.Popen[str]:
        """A process that calls ``first`` before all else."""

        def prepare() -> None:
            # One thread: several add up a gradient in an order that differs from run to run.
            os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
            first()

        return subprocess.Popen(
            self.command(out, *more),
            env=os.environ | environment,
            preexec_fn=prepare,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )

    def finish(self, out: Path, *more: str, **environment: str) -> None:
        process = self.start(out, *more, **environment)
        _, complaint = process.communicate(timeout=900)
        assert process.returncode == 0, complaint


def result(out: Path) -> tuple[bytes, dict, list[dict], dict]:
    """F_adv's values and notes, the log without seconds, and the summary of a finished run.

    The file itself holds its notes in any order.
    """
    log = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
    records = [{k: v for k, v in one.items() if not k.startswith("seconds_")} for one in log]
    with safe_open(out / "F_adv.safetensors", "np") as file:
        feature, notes = file.get_tensor("F_adv").tobytes(), file.metadata()
    return feature, notes, records, json.loads((out / "summary.json").read_text())
