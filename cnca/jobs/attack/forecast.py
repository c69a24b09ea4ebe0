"""What a run will take, estimated from a few of its own steps and one held-out weather.

Steps differ: the first compiles, the first in each weather prepares sky and fog, and the first on a
view renders its background, which is then kept.  So four steps are measured: the first, one in a
new weather, one on new views in a weather that is known, and that one again.
"""

from __future__ import annotations

import resource
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from rich.table import Table

from cnca import build
from cnca.attack.best import Validation
from cnca.attack.loop import start
from cnca.attack.parts import Attack
from cnca.attack.settings import Settings
from cnca.jobs.attack.budget import decided, measure_steps, step_counts
from cnca.jobs.attack.request import Request
from cnca.jobs.attack.run import assemble
from cnca.judge.evaluate import Shots, evaluate
from cnca.judge.held_out import held_out_shots
from cnca.report import MEANING
from cnca.scene.load_scene import load_scene


@dataclass(frozen=True)
class Part:
    """Something that a run does several times."""

    name: str
    times: int
    seconds: float
    """For each time."""


@dataclass(frozen=True)
class Forecast:
    """What a run will take."""

    parts: list[Part]
    memory: int
    """Most bytes of main memory at once."""
    gpu_memory: int | None
    """Most bytes on the generator's GPU, where it has one."""

    @property
    def seconds(self) -> float:
        """From start to report, without the import of libraries."""
        return sum(part.times * part.seconds for part in self.parts)

    def table(self) -> Table:
        """The parts, for people."""
        table = Table("part", "times", "seconds each", "seconds")
        for part in self.parts:
            whole = part.times * part.seconds
            table.add_row(part.name, str(part.times), f"{part.seconds:.2f}", f"{whole:.1f}")
        return table

    def sentence(self) -> str:
        """Time and memory in all."""
        gpu = "" if self.gpu_memory is None else f", {self.gpu_memory / 2**30:.1f} GiB on the GPU"
        return (
            f"about {self.seconds / 60:.1f} minutes, {self.memory / 2**30:.1f} GiB of memory{gpu}"
        )


def forecast(request: Request) -> Forecast:
    """Measure and extrapolate; writes nothing.

    Raises:
        CncaError: what the run itself would raise.
    """
    began = time.perf_counter()
    attack = assemble(request, load_scene(request.scene))
    prepared = Part("preparation", 1, time.perf_counter() - began)
    request = decided(request, attack)
    steps = _measure_steps(attack, request.settings)
    growth = _growth(attack, request.settings)
    others = [*_measure_checks(attack, request.settings), *_measure_verdict(attack, request)]
    parts = [part for part in (prepared, *steps, *others) if part.times]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    device = torch.device(request.device)
    on_gpu = torch.cuda.max_memory_allocated(device) if device.type == "cuda" else None
    return Forecast(parts, peak + growth, on_gpu)


def _measure_steps(attack: Attack, settings: Settings) -> list[Part]:
    names = "first step", "steps in a new weather", "steps on new views", "other steps"
    seconds = measure_steps(attack, settings)
    return [Part(*each) for each in zip(names, step_counts(settings), seconds, strict=True)]


def _growth(attack: Attack, settings: Settings) -> int:
    """Bytes by which kept views will grow beyond those of :func:`_measure_steps`."""
    from cnca.mi_bridge.backgrounds import KeptBackgrounds
    from cnca.mi_bridge.lookups import LookupRenderer

    if not isinstance(attack.renderer, KeptBackgrounds | LookupRenderer):
        return 0
    met = 3 * settings.views_per_step
    coming = min(settings.pool_size, settings.steps * settings.views_per_step) - met
    return max(coming, 0) * round(attack.renderer.megabytes * 1e6 / met)


def _measure_checks(attack: Attack, settings: Settings) -> list[Part]:
    count = sum(settings.checks(step) for step in range(1, settings.steps + 1))
    if count == 0:
        return []
    validation = Validation(attack, settings, attack.generator.encode(settings.prompt))
    latents = start(attack, settings).variables.latents
    seconds = [_seconds(lambda: validation.look(latents)) for _ in range(2)]
    return [Part("first check", 1, seconds[0]), Part("other checks", count - 1, seconds[1])]


def _measure_verdict(attack: Attack, request: Request) -> list[Part]:
    """The first weather compiles, and each is prepared for the first texture."""
    shots = held_out_shots(attack.scene, request.held_out_views, request.settings.seed)
    vehicle = build.build_vehicle(attack.scene)
    renderer = build.build_renderer(attack.scene, vehicle, backend=request.backend)
    albedos, count = {"before": attack.paint.apply()}, len(shots.weathers)

    def judge(weather: int) -> float:
        one = Shots(shots.views[weather:][:1], shots.weathers[weather:][:1], shots.seed)
        return _seconds(lambda: evaluate(renderer, attack.targets, albedos, one))

    first, new, known = judge(0), judge(count - 1), judge(count - 1)
    return [
        Part("first held-out weather", 1, first),
        Part("other held-out weathers", count - 1, new),
        Part("the same in other textures", (len(textures_of(request)) - 1) * count, known),
    ]


def textures_of(request: Request) -> list[str]:
    """What a run is judged in: the camouflage, plain paint and the controls that it has."""
    return [name for name in MEANING if name != "seeds" or request.control_seeds]


def _seconds(work: Callable[[], Any]) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began
