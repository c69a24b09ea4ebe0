"""What a second process brings to an attack, each on one core, and what the two send each other.

    python benchmarks/ranks.py

Steps of the attack with the shipped parts, under torchrun with one process on one core and with two
on two, in turn: once with as many views in all, once with as many for each.  All steps look at the
same views in one weather; the first, which compiles and renders the backgrounds, is left out.

wall      seconds on the clock: true where both cores are free
cpu       processor seconds, of two processes the busier one's: what else runs hardly changes them
sent      bytes of the tensors that the processes sum in a step; in a ring of N each sends
          2 (N - 1) / N times as many (Patarasuk and Yuan 2009)

The efficiency is the work done per core and second over that of one process: its time over twice
that of two with as many views in all, over that of two with as many views for each.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import torch.distributed as dist
from step import SCENE, assemble
from stopwatch import Goal, named_rows, parser, report

from cnca.attack import loop as loop
from cnca.core import parallel
from cnca.scene.load_scene import load_scene
from cnca.scene.variation import draw_views

TORCHRUN = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node"]
RING = (2, 8, 64)
"""Processes for which the bytes that each sends are reckoned."""


def rank(folder: Path, count: int, steps: int, gradient_steps: int) -> None:
    """One process: leaves seconds and bytes of its steps in ``folder``."""
    scene, moments, sent = load_scene(SCENE), [], []
    views, weather = draw_views(scene, count, seed=0), scene.weather()
    loop.draw_pool = lambda scene, settings: lambda step: (views, weather)
    all_reduce = dist.all_reduce

    def counted(tensor) -> None:
        sent.append(tensor.nbytes)
        all_reduce(tensor)

    def after_step(progress, record) -> None:
        moments.append((time.perf_counter(), time.process_time(), sum(sent)))

    dist.all_reduce = counted
    attack = assemble(scene, gradient_steps)
    settings = loop.Settings("zebra", steps=1 + steps, views_per_step=count)
    loop.optimize(attack, settings, loop.start(attack, settings), after_step)
    spent = np.diff(moments, axis=0).tolist()
    (folder / f"{parallel.rank()}.json").write_text(json.dumps(spent))


def launch(processes: int, views: int, options: argparse.Namespace) -> np.ndarray:
    """Steps × (clock, processor seconds, bytes), each of the process where it is most."""
    cores = sorted(os.sched_getaffinity(0))[:processes]
    with tempfile.TemporaryDirectory() as folder:
        numbers = views, options.steps, options.gradient_steps
        command = [*TORCHRUN, str(processes), __file__, "--rank", folder, *map(str, numbers)]
        subprocess.run(command, check=True, preexec_fn=lambda: os.sched_setaffinity(0, cores))
        return np.max([json.loads(f.read_text()) for f in Path(folder).glob("*.json")], axis=0)


def main() -> None:
    """Launch one and two processes in turn."""
    arguments = parser(__doc__)
    arguments.add_argument("--views", type=int, default=8)
    arguments.add_argument("--steps", type=int, default=4, help="of each launch")
    arguments.add_argument("--gradient-steps", type=int, default=10)
    arguments.add_argument("--turns", type=int, default=2)
    options = arguments.parse_args()
    if len(os.sched_getaffinity(0)) < 2:
        arguments.error("two processes need a core each; this machine gives one")
    count = options.views
    spent: dict[tuple[int, int], list[np.ndarray]] = {(1, count): [], (2, count): []}
    spent[2, 2 * count] = []
    for _ in range(options.turns):
        for (processes, views), launches in spent.items():
            launches.append(launch(processes, views, options))
    one, two, more = (np.median(np.concatenate(launches), axis=0) for launches in spent.values())
    rows = {
        f"one process, {count} views": one,
        f"two, {count} views": two,
        f"two, {2 * count} views": more,
        f"efficiency, {count} views in all": one / (2 * two),
        f"efficiency, {count} views for each": one / more,
    }
    seconds = {
        name: dict(zip(("wall", "cpu"), values[:2].round(3).tolist(), strict=True))
        for name, values in rows.items()
    }
    total = int(two[2])
    ring = {f"of {n} processes": round(2 * (n - 1) / n * total) for n in RING}
    goals = [
        Goal(f"{name}, by the clock", row["wall"], 0.9, at_least=True)
        for name, row in seconds.items()
        if name.startswith("efficiency")
    ]
    tables = [
        named_rows("a step", seconds),
        named_rows(f"of {total} bytes summed in a step", {"each sends, in a ring": ring}),
    ]
    measured = {"seconds": seconds, "bytes_summed": total, "bytes_sent_by_each": ring}
    report(options, "ranks", measured, goals, tables)


if __name__ == "__main__":
    if "--rank" in sys.argv:
        where, *numbers = sys.argv[sys.argv.index("--rank") + 1 :]
        with parallel.joined():
            rank(Path(where), *map(int, numbers))
    else:
        main()
