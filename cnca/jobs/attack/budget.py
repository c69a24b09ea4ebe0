"""How many steps a run takes in a number of minutes, measured on its own first steps.

The count is decided once and written into the manifest: going on after an interruption, or
repeating the run from its manifest, takes that many steps, however fast the machine is then.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace

from cnca.attack.loop import optimize, start
from cnca.attack.parts import Attack
from cnca.attack.settings import Settings
from cnca.core import parallel
from cnca.core.run_folder import RunFolder
from cnca.jobs.attack.request import JOB, Request

LEAST, MOST = 8, 400
"""Steps below which no attack gets far, and above which more bring no gain."""
ATTACKING = 0.7
"""Share of the minutes that the steps get; preparation and verdict take the rest."""


def recorded(request: Request) -> Request:
    """The request with the number of steps that its folder was begun with, where it was."""
    folder = RunFolder(request.out, JOB)
    if request.minutes is None or not folder.occupied:
        return request
    content = json.loads(folder.manifest.read_text(encoding="utf-8"))
    steps = content.get("request", {}).get("settings", {}).get("steps")
    return _with_steps(request, steps) if isinstance(steps, int) else request


def decided(request: Request, attack: Attack) -> Request:
    """The request with as many steps as its minutes allow; unchanged without minutes.

    All processes of a job call this at once, and the first decides.
    """
    request = recorded(request)
    if request.minutes is None:
        return request
    seconds, budget = measure_steps(attack, request.settings), ATTACKING * 60 * request.minutes
    return _with_steps(
        request, parallel.by_first(lambda: steps_within(budget, seconds, request.settings))
    )


def steps_within(budget: float, seconds: Sequence[float], settings: Settings) -> int:
    """The most steps that take no more than ``budget`` seconds, from 8 to 400.

    ``seconds``: of each kind of step, in the order of :func:`step_counts`.
    """
    steps = LEAST
    while steps < MOST:
        counts = step_counts(replace(settings, steps=steps + 1))
        if sum(n * s for n, s in zip(counts, seconds, strict=True)) > budget:
            break
        steps += 1
    return steps


def step_counts(settings: Settings) -> tuple[int, int, int, int]:
    """How many steps are the first, in a new weather, on new views in a known one, and neither."""
    turns = -(-settings.pool_size // (settings.weathers * settings.views_per_step))
    weathers = min(settings.steps, settings.weathers)
    met = min(settings.steps, settings.weathers * turns)
    return 1, weathers - 1, met - weathers, settings.steps - met


def measure_steps(attack: Attack, settings: Settings) -> list[float]:
    """Seconds of each kind of step; what renderers keep of them serves the run as well."""
    seconds: list[float] = []
    # The first step, one in a new weather, one on new views in a known one, and that once more.
    for step in (0, 1, settings.weathers, settings.weathers):
        once = replace(settings, steps=step + 1, check_every=0, patience=0)
        progress = replace(start(attack, once), step=step)
        optimize(attack, once, progress, lambda _, record: seconds.append(record.seconds_total))
    return seconds


def _with_steps(request: Request, steps: int) -> Request:
    return replace(request, minutes=None, settings=replace(request.settings, steps=steps))
