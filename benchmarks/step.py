"""What a step of the attack spends beside the work itself.

    python benchmarks/step.py

backward    forward and backward over forward, in processor seconds, by the loop's renderer
outside     share of a step, its checkpoint included, that is neither diffusion, rendering nor
            detection, forward or backward; over the steps after the first round of weathers
compiled    kernels in those steps that the first round had not made, by the kernel history
growth      of the process's memory between step 100 and the last of many small steps without
            diffusion
codegen     seconds of a step in which Dr.Jit writes its kernels down again to find them compiled
start       seconds from the start of a process to its first picture on disk, kernels cached; the
            goal is held to processor seconds, which the clock does not exceed on an idle machine
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from stopwatch import Goal, in_turn, named_rows, parser, report

from cnca import build
from cnca.attack import checkpoint
from cnca.attack.loop import WEATHERS, Attack, Progress, Settings, optimize, start
from cnca.attack.records import StepRecord
from cnca.attack.targets import look, weighted_loss
from cnca.core.color import linear_to_srgb
from cnca.core.errors import RunError
from cnca.mi_bridge.variant import dr
from cnca.scene.load_scene import load_scene
from cnca.scene.schema import Scene
from cnca.scene.variation import draw_views

SCENE = Path("scenes/sedan_clear.yaml")
SETTLED = 100
"""Small steps after which memory is first looked at."""
STARTS = 3
MEGABYTE = 2**20


def sized(scene: Scene, side: int) -> Scene:
    """The scene with smaller pictures."""
    image = scene.image.model_copy(update={"width": side, "height": side})
    return scene.model_copy(update={"image": image})


def assemble(scene: Scene, gradient_steps: int) -> Attack:
    """The shipped parts."""
    vehicle = build.build_vehicle(scene)
    paint = build.build_paint(scene, vehicle)
    return Attack(
        scene=scene,
        renderer=build.build_loop_renderer(scene, vehicle, paint, backend="mitsuba", samples=16),
        paint=paint,
        generator=build.build_generator(None, gradient_steps=gradient_steps),
        targets=build.build_targets(["builtin"]),
    )


def backward(attack: Attack, turns: int) -> dict[str, float]:
    """Processor seconds of a loop's rendering."""
    views, weather = draw_views(attack.scene, 8, seed=0), attack.scene.weather()
    albedo = attack.paint.apply()

    def forward(seed: int) -> None:
        with torch.no_grad():
            attack.renderer.render(albedo, views, weather, seed=seed)

    def both(seed: int) -> None:
        leaf = albedo.clone().requires_grad_()
        attack.renderer.render(leaf, views, weather, seed=seed).square().mean().backward()

    costs, _ = in_turn({"forward": forward, "both": both}, turns)
    seconds = {name: round(cost.cpu, 4) for name, cost in costs.items()}
    return seconds | {"ratio": round(costs["both"].cpu / costs["forward"].cpu, 2)}


@dataclass(frozen=True)
class Round:
    """A step of the second round of weathers, by its median; times in seconds."""

    seconds: dict[str, float]
    outside: float
    codegen: float
    kernels_run: int
    compiled: int


def rounds(attack: Attack) -> Round:
    """Two rounds of all weathers by the attack's own loop; the second is looked at."""
    settings = Settings("zebra", steps=2 * WEATHERS, views_per_step=4, view_pool=4 * WEATHERS)
    records: list[StepRecord] = []
    ends: list[float] = []

    with (
        tempfile.TemporaryDirectory() as folder,
        dr.scoped_set_flag(dr.JitFlag.KernelHistory, True),
    ):

        def after_step(progress: Progress, record: StepRecord) -> None:
            checkpoint.save(progress, Path(folder) / "checkpoint.pt")
            records.append(record)
            ends.append(time.perf_counter())
            if progress.step == WEATHERS:
                dr.kernel_history_clear()

        optimize(attack, settings, start(attack, settings), after_step)
        kernels = [k for k in dr.kernel_history() if "cache_hit" in k]
    names = ("generate", "render", "detect", "backward")
    second = records[WEATHERS:]
    parts = {name: np.array([record.seconds[name] for record in second]) for name in names}
    total = np.diff(ends)[WEATHERS - 1 :]
    outside = 1 - np.sum(list(parts.values()), axis=0) / total
    return Round(
        seconds={name: round(float(np.median(part)), 4) for name, part in parts.items()},
        outside=round(float(np.median(outside)), 4),
        codegen=round(sum(k["codegen_time"] for k in kernels) / 1000 / WEATHERS, 4),
        kernels_run=len(kernels),
        compiled=sum(not kernel["cache_hit"] for kernel in kernels),
    )


def growth(attack: Attack, steps: int) -> dict[str, float]:
    """Memory of small steps on a free texture."""
    views, weather = draw_views(attack.scene, 2, seed=0), attack.scene.weather()
    boxes = attack.renderer.vehicle_boxes(views)
    texture = attack.paint.apply().clone().requires_grad_()
    optimizer = torch.optim.Adam([texture], lr=0.01)
    held = {}
    for step in range(1, steps + 1):
        images = attack.renderer.render(texture, views, weather, seed=step)
        seen = look(attack.objective, attack.targets, linear_to_srgb(images), boxes)
        optimizer.zero_grad()
        weighted_loss(attack.targets, seen).backward()
        optimizer.step()
        with torch.no_grad():
            texture.clamp_(0, 1)
        if step in (SETTLED, steps):
            held[step] = resident()
    return {
        "steps": steps,
        "megabytes": round(held[steps], 1),
        "growth": round(held[steps] / held[SETTLED] - 1, 4),
    }


def resident() -> float:
    """Megabytes of the process that lie in memory."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / MEGABYTE


def first_image() -> dict[str, float]:
    """Clock and processor seconds until a process has left its picture; the first one warms up."""
    with tempfile.TemporaryDirectory() as folder:
        spent = [start_of(Path(folder) / f"{turn}.png") for turn in range(STARTS + 1)]
    wall, cpu = np.median(spent[1:], axis=0)
    return {"wall": round(float(wall), 2), "cpu": round(float(cpu), 2)}


def start_of(picture: Path) -> tuple[float, float]:
    """Clock and processor seconds from the start of a process to its picture on disk."""
    command = [sys.executable, "-m", "cnca", "render-scene", str(SCENE), "-o", str(picture)]
    started = time.perf_counter()
    with subprocess.Popen([*command, "--spp", "16"], stdout=subprocess.DEVNULL) as process:
        while not picture.exists():
            if process.poll() is not None:
                raise RunError(f"{picture}: not written; see what render-scene says above")
            time.sleep(0.005)
        return time.perf_counter() - started, processor_seconds(process.pid)


def processor_seconds(process: int) -> float:
    """Of a running process and of those that it has waited for."""
    stat = Path(f"/proc/{process}/stat").read_text()
    ticks = stat.rpartition(")")[2].split()[11:15]  # utime, stime, cutime, cstime: proc(5)
    return sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK")


def main() -> None:
    """Measure all parts."""
    arguments = parser(__doc__)
    arguments.add_argument("--turns", type=int, default=7)
    arguments.add_argument("--small-steps", type=int, default=1000)
    arguments.add_argument("--gradient-steps", type=int, default=10)
    options: argparse.Namespace = arguments.parse_args()
    if options.small_steps <= SETTLED:
        arguments.error(f"--small-steps: give more than {SETTLED}")

    start_of_process = first_image()
    scene = load_scene(SCENE)
    attack = assemble(scene, options.gradient_steps)
    ratio, loop = backward(attack, options.turns), rounds(attack)
    memory = growth(assemble(sized(scene, 32), 1), options.small_steps)
    goals = [
        Goal("forward and backward over forward", ratio["ratio"], 2.5),
        Goal("share of a step outside of its three parts", loop.outside, 0.05),
        Goal("kernels compiled after the first round", loop.compiled, 0),
        Goal(f"growth of memory over {options.small_steps} steps", memory["growth"], 0.02),
        Goal("processor seconds to the first picture", start_of_process["cpu"], 3),
    ]
    measured = {
        "rendering": ratio,
        "loop": asdict(loop),
        "memory": memory,
        "start": start_of_process,
    }
    table = named_rows("seconds on the clock, median", {"of a step": loop.seconds})
    report(options, "step", measured, goals, [table])


if __name__ == "__main__":
    main()
