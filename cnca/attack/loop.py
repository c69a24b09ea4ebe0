"""The attack: prompt → diffusion → texture → path tracer → detector → loss → F_adv, noises.

=====================  =========================================================
in the code            in the paper
=====================  =========================================================
``text_feature``       F_txt (equation 7)
``variables``          F_adv, within τ (``Settings.tau``); or the noises of DDIM
``texture``            T_adv = T2I([κ(F_adv), F_txt]) (equation 8)
``attack.objective``   L_adv of D_s (equation 11), or another
``optimizer.step``     the update of F_adv (equation 12; Adam, section 4.1)
``variables.project``  κ (equation 13)
=====================  =========================================================
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import torch

from cnca.attack import variables
from cnca.attack.best import Best, Validation
from cnca.attack.jitter import jittered
from cnca.attack.parts import Attack
from cnca.attack.records import StepRecord, step_record
from cnca.attack.settings import Settings
from cnca.attack.targets import (
    look,
    readings,
    refuse_black_boxes,
    refuse_non_finite,
    weighted_loss,
)
from cnca.attack.variables import Variables
from cnca.core import parallel
from cnca.core.color import linear_to_srgb
from cnca.core.errors import RunError
from cnca.core.types import SrgbImages, SrgbTexture
from cnca.gen.feature import UPDATES
from cnca.gen.latents import Latents
from cnca.scene.cameras import View
from cnca.scene.schema import Scene
from cnca.scene.variation import in_blocks
from cnca.scene.weather import Weather
from cnca.world.draw import draw_blocks


@dataclass
class Progress:
    """All that changes from step to step: enough to go on after an interruption, and to look at."""

    step: int
    variables: Variables
    optimizer: torch.optim.Optimizer
    best: Best = field(default_factory=Best)
    seen: tuple[SrgbTexture, SrgbImages] | None = None
    """The last step's texture and what the detectors saw of it, once around the vehicle; of several
    processes, the own part of that."""

    @property
    def result(self) -> Latents:
        """The best of the latents that were checked, else the last."""
        return self.variables.copy() if self.best.latents is None else self.best.latents


def start(attack: Attack, settings: Settings) -> Progress:
    """The variables at or near their origin, and their optimizer."""
    moved = variables.start(attack.generator, settings)
    update: Any = UPDATES[settings.update]
    return Progress(0, moved, update(moved.tensors, lr=settings.learning_rate))


def optimize(
    attack: Attack,
    settings: Settings,
    progress: Progress,
    after_step: Callable[[Progress, StepRecord], None],
) -> Latents:
    """Run the attack to its last step, or until checks show no gain; returns the best latents.

    After every step ``after_step`` is given the progress and the record of the step.

    Raises:
        DetectorError: a detector gives no gradient.
        NonFiniteError: a detector's loss, or a variable's gradient, is not finite.
        RunError: there are more processes than views in a step.
    """
    refuse_black_boxes(attack.targets)
    text_feature = attack.generator.encode(settings.prompt)
    pool = draw_pool(attack.scene, settings)
    validation = Validation(attack, settings, text_feature)
    moved, optimizer, best = progress.variables, progress.optimizer, progress.best
    while progress.step < settings.steps and not best.exhausted(settings.patience):
        clock, step = Clock(), progress.step
        every, weather = pool(step)
        views = parallel.share(every)
        seed = settings.seed * 1_000_003 + step
        boxes, where = attack.renderer.vehicle_boxes(views), f"step {step} (seed {seed})"
        with clock("generate"):
            texture = attack.texture(text_feature, moved.latents, settings.seed, together=True)
            albedo = attack.paint.apply(texture)
        with clock("render"):
            pictures = linear_to_srgb(attack.render(albedo, views, weather, seed))
            if settings.jitter:
                pictures, boxes = jittered(pictures, boxes, views, seed)
        with clock("detect"):
            seen = look(attack.objective, attack.targets, pictures, boxes)
        refuse_non_finite(attack.targets, seen, where)

        optimizer.zero_grad()
        with clock("backward"):
            seen = seen * len(views) / len(every)
            penalty = moved.penalty() + (attack.style(texture) if attack.style else 0.0)
            (weighted_loss(attack.targets, seen) + penalty / parallel.count()).backward()
            parallel.add_up(*moved.gradients(), seen)
        moved.refuse_non_finite(where)
        optimizer.param_groups[0]["lr"] = settings.step_size(step)
        optimizer.step()
        moved.project()

        progress.step += 1
        progress.seen = SrgbTexture(texture.detach()), SrgbImages(pictures.detach())
        record, checked = readings(attack.targets, seen), None
        if settings.checks(progress.step):
            with clock("check"):
                checked = validation.look(moved.latents)
            best.offer(moved.copy(), checked.loss_adv, progress.step)
        after_step(progress, step_record(progress.step, record, checked, clock.seconds()))
    return progress.result


def draw_pool(scene: Scene, settings: Settings) -> Callable[[int], tuple[list[View], Weather]]:
    """Return what each step looks at: views of one weather, the weathers taken in turn."""
    count = settings.views_per_step
    if count < parallel.count():
        raise RunError(
            f"views_per_step is {count}: give each of the {parallel.count()} processes at least one"
        )
    blocks, seed = settings.weathers, settings.seed
    in_weather, weathers = draw_blocks(scene, settings.pool_size, blocks, seed=seed)

    def step_views(step: int) -> tuple[list[View], Weather]:
        turn, k = divmod(step, blocks)
        return views_of_turn(in_weather[k], count, turn, seed=seed + k), weathers[k]

    return step_views


def views_of_turn(views: Sequence[View], count: int, turn: int, *, seed: int) -> list[View]:
    """``count`` of these views: each epoch visits all of them, in a new order.

    The views are taken by azimuth, one of each ``count``-th part of the circle, so that a step
    looks at the vehicle from all around.  Seeded by the epoch: a turn is known by its number.
    """
    around = sorted(views, key=lambda view: math.atan2(view.origin[1], view.origin[0]))
    parts = in_blocks(around, count)
    epoch, place = divmod(turn, -(-len(views) // count))
    rng = torch.Generator().manual_seed(seed * 1_009 + epoch)
    orders = [torch.randperm(len(part), generator=rng).tolist() for part in parts]
    return [part[order[place % len(part)]] for part, order in zip(parts, orders, strict=True)]


class Clock:
    """Seconds per named part of a step."""

    def __init__(self) -> None:
        self._started = time.perf_counter()
        self._parts: dict[str, float] = {}

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        """Book the time of the block under ``name``."""
        started = time.perf_counter()
        yield
        self._parts[name] = time.perf_counter() - started

    def seconds(self) -> dict[str, float]:
        """Seconds of each part by name and, as ``total``, those since the clock was made."""
        return self._parts | {"total": time.perf_counter() - self._started}
