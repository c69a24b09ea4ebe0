"""Pictures whose error is measured while they are made: just under a target, or in given seconds.

A pilot (:mod:`cnca.jobs.accuracy.pilot`) chooses the models.  Then rays are spent in rounds, in two
independent streams whose difference tells the noise, until the error of the vehicle's pixels lies
under the target; the rest of the picture gets as many rays per pixel at most.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Int

from cnca.core.errors import RunError
from cnca.core.types import LinearImages, LinearTexture
from cnca.effects.effect import Model
from cnca.effects.plan import MOST_SAMPLES, Demand, EffectPlan
from cnca.effects.prices import Prices, shipped_prices
from cnca.effects.proposals import Models
from cnca.effects.protocols import PlanningRenderer
from cnca.jobs.accuracy.fidelity import Pixels, mean_and_error
from cnca.jobs.accuracy.pilot import Pilot, Trial
from cnca.jobs.accuracy.spending import variance, wanted, whole
from cnca.jobs.accuracy.streams import Draw, Squares, Streams
from cnca.scene.cameras import View
from cnca.scene.weather import Weather

AIM = 0.9
"""Share of the target that the measured error aims at: what is measured is not quite what is."""
SECONDS_RAYS = 8
"""Of a pixel in one step of one stream, where seconds are given."""
CAUTION = 0.6
"""Share of the seconds left that a round may take by the last one's pace."""


@dataclass(frozen=True)
class MeasuredError:
    """Of a picture, over the vehicle's pixels, as :mod:`cnca.effects.prices` counts errors."""

    error: float
    """Bias and noise together."""
    bias: float
    """Of the models beside the best ones; an upper bound where noise hides it."""
    noise: float
    samples: float
    """Mean rays per pixel of the vehicle."""
    pilot_seconds: float
    """Processor seconds of the pilot, kernels included."""
    seconds: float
    """Processor seconds in all."""
    trials: list[Trial]
    """What the pilot tried; the first are the best models."""


@dataclass(frozen=True)
class Scenery:
    """What is rendered."""

    renderer: PlanningRenderer
    albedo: LinearTexture
    view: View
    weather: Weather
    forced: Mapping[str, Model]
    """Models asked for by name."""

    def plan(self, models: Models, samples: int, target: float | None = None) -> EffectPlan:
        """The plan of these models, of which some were asked for by name."""
        demand = self._demand(models, samples)
        chosen = self.renderer.plan(self.albedo, [self.view], self.weather, demand=demand)
        return replace(chosen, demand=Demand(target, forced=self.forced))

    def draw(self, models: Models, rays: int) -> Draw:
        """What draws pixels, with so many rays for each."""
        demand = self._demand(models, rays)

        @torch.no_grad()
        def pixels(chosen: Int[np.ndarray, " chosen"], seed: int, first: int) -> Pixels:
            drawn = self.renderer.render_pixels(
                self.albedo,
                [self.view],
                self.weather,
                chosen,
                seed=seed,
                first=first,
                demand=demand,
            )
            return drawn.numpy().astype(np.float64)

        return pixels

    def _demand(self, models: Models, samples: int) -> Demand:
        forced = {**self.forced, **models, "samples": samples, "gradient": "off"}
        return Demand(forced=forced)


def meet(
    scenery: Scenery,
    *,
    target: float | None = None,
    seconds: float | None = None,
    seed: int = 0,
    prices: Prices | None = None,
) -> tuple[LinearImages, EffectPlan, MeasuredError]:
    """A picture (1, 3, height, width) just under the target error, or the best in some seconds.

    With it come the plan that the pilot made and the error that was measured.

    Args:
        seconds: processor seconds, the pilot's included.

    Raises:
        RunError: neither or both are given.
    """
    if (target is None) == (seconds is None):
        raise RunError("a picture is made for a target error or for seconds: give one of them")
    began, prices = time.process_time(), prices or shipped_prices()
    view = scenery.view
    mask = scenery.renderer.vehicle_mask([view])[0]
    focus = mask == 1 if (mask == 1).any() else mask > 0
    rays = _rays(scenery, target, prices)
    first = scenery.plan(scenery.forced, rays)
    pilot = Pilot(
        lambda models: scenery.draw(models, rays),
        np.flatnonzero(focus),
        mask.size,
        subject=first.subject,
        forced=scenery.forced,
        prices=prices,
        rays=rays,
        seeds=_seeds(seed, 0),
    )
    left = math.inf if seconds is None else seconds - (time.process_time() - began)
    trial = pilot.choose(target or pilot.reachable(left), left)
    piloted = time.process_time() - began
    streams = Streams(
        scenery.draw(trial.models, rays), np.arange(mask.size), rays=rays, seeds=_seeds(seed, 1)
    )
    goal = 0.0 if target is None else (AIM * target) ** 2 - trial.bias**2
    deadline = math.inf if seconds is None else began + seconds
    spend(streams, focus, goal, deadline)
    noise = float(np.sqrt(streams.noise()[focus.ravel()].mean()))
    picture = torch.from_numpy(streams.mean.reshape(*mask.shape, 3)).float().permute(2, 0, 1)
    samples = float(2 * rays * streams.steps[focus.ravel()].mean())
    measured = MeasuredError(
        error=math.hypot(trial.bias, noise),
        bias=trial.bias,
        noise=noise,
        samples=samples,
        pilot_seconds=piloted,
        seconds=time.process_time() - began,
        trials=pilot.trials,
    )
    plan = scenery.plan(trial.models, max(round(samples), 1), target)
    return LinearImages(picture[None].contiguous()), plan, measured


def spend(
    streams: Streams, focus: Bool[np.ndarray, "h w"], goal: float, deadline: float = math.inf
) -> None:
    """Take rays until the squared noise of the focus lies under the goal, or time is up.

    Args:
        deadline: of the processor's clock.
    """
    begun = time.process_time()
    streams.advance(1)  # makes kernels, if any
    turn, pace, least = 0, 0.0, 0.0 if deadline == math.inf else 0.05 * (deadline - begun)
    while (left := deadline - (now := time.process_time())) > least:
        more, before = next_steps(streams, focus, goal, turn), streams.rays_spent
        if left < math.inf:
            room = CAUTION * left / max(pace * 2 * streams.rays * more.sum(), 1e-9)
            more = np.minimum(more, 1) if turn == 0 else whole(more * min(room, 1.0), turn)
        if not more.any():
            break
        streams.add(more)
        pace = (time.process_time() - now) / (streams.rays_spent - before)
        turn += 1


def next_steps(
    streams: Streams, focus: Bool[np.ndarray, "h w"], goal: float, turn: int
) -> Int[np.ndarray, " pixels"]:
    """What the next round adds to each pixel; nothing where the goal is reached."""
    more = np.zeros(focus.size, dtype=np.int64)
    noise, inside = streams.noise(), focus.ravel()
    square, error = mean_and_error(noise[inside])
    if square + error > goal and 2 * streams.rays * streams.steps[inside].mean() < MOST_SAMPLES:
        share = goal * square / (square + error)
        more[inside] = _more(streams, noise, focus, max(share, square / 3), math.inf, turn)
    beside = ~inside
    if beside.any() and noise[beside].mean() > max(goal, square):
        room = float((streams.steps + more)[inside].mean() - streams.steps[beside].mean())
        more[beside] = _more(streams, noise, ~focus, max(goal, square), room, turn)
    return more


def _more(
    streams: Streams,
    noise: Squares,
    group: Bool[np.ndarray, "h w"],
    goal: float,
    most: float,
    turn: int,
) -> Int[np.ndarray, " group"]:
    """Steps for a group of pixels, ``most`` in the mean.

    Where noise ∝ 1/√n asks for many, half are taken: evenly spread rays do better than that.
    """
    chosen = group.ravel()
    steps = streams.steps[chosen]
    missing = wanted(variance(noise[chosen], steps, group), steps, goal) - steps
    mean = float(missing.mean())
    limit = min(max(0.5 * mean, 0.1 * float(steps.mean())), most)
    return whole(missing * min(limit / max(mean, 1e-9), 1.0), turn) if limit > 0.01 else 0 * steps


def _rays(scenery: Scenery, target: float | None, prices: Prices) -> int:
    """Of a pixel in one step of one stream: a power of two, so that steps are about ten."""
    if target is None:
        return SECONDS_RAYS
    subject = scenery.plan({}, 1).subject
    return max(min(prices.samples_for(target, subject, MOST_SAMPLES) // 32, 64), 1)


def _seeds(seed: int, use: int) -> tuple[int, int]:
    """Of both streams; the pilot's differ from the picture's."""
    first = (seed * 4 + 2 * use + 0x2F0B4C47) & 0xFFFFFFFF
    return first, first + 1
