"""A few rays that tell this view's noise and this scene's bias of the models that may be taken.

A trial renders the same pixels with the same random numbers as the best models did, so that most of
the noise cancels in the difference D of both.  It is done in two independent streams, so that

    bias² = mean(w D₁ D₂),   w = 1 / (L² + 0.01),

has the right expectation however few rays there are, and a standard error.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Int

from cnca.effects.effect import Model
from cnca.effects.plan import predicted_bias, predicted_seconds
from cnca.effects.prices import Prices
from cnca.effects.proposals import Models, best_models, propose, relative_cost
from cnca.effects.subject import Subject
from cnca.jobs.accuracy.fidelity import mean_and_error, weight
from cnca.jobs.accuracy.streams import Draw, Streams

STEPS = 4
"""Of each stream, before it is asked whether they were enough."""
MOST_STEPS = 64
SURE = 0.1
"""Standard error of a squared bias over the squared target that is small enough."""
MOST_TRIALS = 5
MOST_PIXELS = 2048
MOST_TIMED = 1 << 16
"""Pixels of the draw that tells the time of a ray."""
WORN = ("materials", "glass", "wetness")
"""Effects whose model is built into the geometry: a world would be built anew for each."""


@dataclass(frozen=True)
class Trial:
    """What was measured of some models."""

    models: Mapping[str, Model]
    bias_square: float
    """Beside the best models; below 0 where noise hides it."""
    bias_square_error: float
    """Its standard error."""
    noise: float
    """Relative, of one step of both streams."""
    seconds: float
    """Processor seconds of all of it."""

    @property
    def bias(self) -> float:
        """An upper bound that it hardly exceeds."""
        return float(np.sqrt(max(self.bias_square, 0.0) + self.bias_square_error))


class Pilot:
    """Trials on one set of pixels."""

    def __init__(
        self,
        draw: Callable[[Models], Draw],
        pixels: Int[np.ndarray, " pixels"],
        size: int,
        *,
        subject: Subject,
        forced: Models,
        prices: Prices,
        rays: int,
        seeds: tuple[int, int],
    ) -> None:
        """
        Args:
            draw: what draws pixels with those models.
            pixels: of the vehicle.
            size: pixels of the whole picture.
            rays: of a pixel in one step of one stream.
            seeds: of the streams.
        """
        self._draw, self._rays, self._seeds = draw, rays, seeds
        self._pixels = pixels[:: -(-len(pixels) // MOST_PIXELS)]
        self._subject, self._forced, self._prices = subject, forced, prices
        in_world = bool(subject.amounts.get("surroundings"))
        best = best_models(subject, forced)
        self._free = [n for n in best if n not in forced and not (in_world and n in WORN)]
        self.trials: list[Trial] = []
        self._best, self._size, began = self._streams(best), size, time.process_time()
        self._best.advance(STEPS)
        now = time.process_time()
        everything = np.arange(min(size, MOST_TIMED))  # as fast as the picture will be
        draw(best)(everything, seeds[0], STEPS * rays)
        work = rays * len(everything) * predicted_seconds(best, prices)
        self._pace = (time.process_time() - now) / work
        self.trials.append(Trial(best, 0.0, 0.0, _noise(self._best), now - began))

    def _streams(self, models: Models) -> Streams:
        return Streams(self._draw(models), self._pixels, rays=self._rays, seeds=self._seeds)

    def try_out(self, models: Models, target: float) -> Trial:
        """Measure the bias until it is known well enough for that target, and the noise."""
        began = time.process_time()
        streams = self._streams(models)
        steps = int(self._best.steps[0])
        while True:
            self._best.advance(steps - int(self._best.steps[0]))
            streams.advance(steps - int(streams.steps[0]))
            square, error = _squared_bias(streams, self._best)
            hopeless = square - 2 * error > target**2
            if error <= SURE * target**2 or hopeless or steps >= MOST_STEPS:
                break
            steps *= 2
        trial = Trial(models, square, error, _noise(streams), time.process_time() - began)
        self.trials.append(trial)
        return trial

    def choose(self, target: float, left: float = math.inf) -> Trial:
        """The models with which the picture takes least time under the target.

        What the price list proposes is tried once, and more where it saves more than it costs, as
        long as trials take no more than half of the processor seconds that are left.
        """
        scale, deadline = 1.0, time.process_time() + left / 2 - self.trials[0].seconds
        while len(self.trials) <= MOST_TRIALS and time.process_time() < deadline:
            tried = [trial.models for trial in self.trials]
            models = propose(
                self._subject,
                target,
                free=self._free,
                forced=self._forced,
                prices=self._prices,
                scale=scale,
                tried=tried,
            )
            if models is None:
                break
            cheapest, predicted = self._cheapest(target), self._predicted_bias(models)
            guess = replace(cheapest, models=models, bias_square=(scale * predicted) ** 2)
            saved = self.seconds(cheapest, target) - self.seconds(guess, target)
            if len(tried) > 1 and saved < self.trials[0].seconds:
                break
            trial = self.try_out(models, target)
            scale = trial.bias / predicted if predicted > 0 else scale
        return self._cheapest(target)

    def reachable(self, seconds: float) -> float:
        """Error of the picture by the best models in some processor seconds."""
        best = self.trials[0]
        return best.noise * math.sqrt(self.seconds(best, best.noise) / max(seconds, 1e-3))

    def seconds(self, trial: Trial, target: float) -> float:
        """Processor seconds of the picture; infinite where the bias is too large."""
        steps = relative_cost(trial.models, self._prices, trial.noise, trial.bias, target)
        return steps * self._pace * 2 * self._rays * self._size

    def _cheapest(self, target: float) -> Trial:
        return min(self.trials, key=lambda trial: self.seconds(trial, target))

    def _predicted_bias(self, models: Models) -> float:
        return predicted_bias(models, self._subject, self._prices)


def _noise(streams: Streams) -> float:
    """Of one step of both streams."""
    return float(np.sqrt(np.mean(streams.noise() * streams.steps)))


def _squared_bias(streams: Streams, best: Streams) -> tuple[float, float]:
    """Squared bias and its standard error; both have the same random numbers."""
    references = best.halves
    first, second = (found - r for found, r in zip(streams.halves, references, strict=True))
    return mean_and_error(first * second * weight(references))
