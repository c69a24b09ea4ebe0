"""Which effects a scene calls for: what is rendered how, and why.

A scene names no models.  :func:`plan` chooses one for each effect: the usual ones, the full
simulation, or, for a target error, the cheapest combination whose predicted error lies under it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from cnca.core.errors import CncaError
from cnca.effects.catalog import EFFECTS
from cnca.effects.effect import Model
from cnca.effects.prices import Prices, shipped_prices
from cnca.effects.subject import Subject
from cnca.scene.weather import Weather

REFERENCE_SAMPLES = 1024
MOST_SAMPLES = 4096
"""Rays per pixel beyond which a target error counts as out of reach."""


@dataclass(frozen=True)
class Demand:
    """What is asked of a picture."""

    target_error: float | None = None
    """Error to stay under (see :mod:`cnca.effects.prices`); None takes the usual models."""
    reference: bool = False
    """Full simulation."""
    forced: Mapping[str, Model] = field(default_factory=dict)
    """Effect → model, whatever else would be chosen."""

    def __post_init__(self) -> None:
        if self.target_error is not None and not 0 < self.target_error < math.inf:
            raise CncaError(f"target error {self.target_error:g}: must be above 0, such as 0.02")


@dataclass(frozen=True)
class EffectPlan:
    """One model for each effect."""

    models: Mapping[str, Model]
    subject: Subject
    demand: Demand

    def __getitem__(self, effect: str) -> Model:
        return self.models[effect]

    @property
    def bounces(self) -> int:
        """Surface reflections of a path."""
        return int(self["interreflection"])

    @property
    def samples(self) -> int:
        """Rays per pixel."""
        return int(self["samples"])

    @property
    def weather(self) -> Weather:
        """The weather without what is left out."""
        weather = self.subject.weather
        for name, effect in EFFECTS.items():
            weather = effect.within(self[name], weather)
        return weather


def plan(
    subject: Subject,
    demand: Demand,
    prices: Prices | None = None,
    *,
    usual: Mapping[str, Model] | None = None,
) -> EffectPlan:
    """Choose a model for each effect.

    With a target error this is the cheapest combination of models and samples with

        (sum of the models' errors)² + noise² ≤ target²,

    all predicted by ``prices`` (by default those that ship).

    Args:
        usual: effect → model that stands for the effect's own usual one.
    """

    def possible(models: Mapping[str, Model]) -> dict[str, Model]:
        return {name: m for name, m in models.items() if EFFECTS[name].possible(m, subject)}

    forced = possible(demand.forced)
    models = {name: effect.present(subject)[-1] for name, effect in EFFECTS.items()}
    if demand.reference:
        models["samples"] = REFERENCE_SAMPLES
    else:
        preset = {name: e.usual for name, e in EFFECTS.items() if e.usual is not None}
        models |= possible(preset | dict(usual or {}))
        if demand.target_error is not None:
            target, prices = demand.target_error, prices or shipped_prices()
            models |= _cheapest(subject, target, forced, prices)
    return EffectPlan(models | forced, subject, demand)


def _cheapest(
    subject: Subject, target: float, forced: Mapping[str, Model], prices: Prices
) -> dict[str, Model]:
    """Models and samples; where the target is out of reach, those with the smallest error."""
    options = {
        name: [forced[name]] if name in forced else effect.candidates(subject, prices)
        for name, effect in EFFECTS.items()
        if effect.has_bias
    }
    free = [EFFECTS[name] for name in options if name not in forced]

    def rank(models: dict[str, Model]) -> tuple[float, float]:
        error, samples = predicted_error(models, subject, prices), int(models["samples"])
        return max(error, target), samples * predicted_seconds(models, prices)

    ranked = []
    for combination in itertools.product(*options.values()):
        models = dict(zip(options, combination, strict=True))
        if any(effect.unforeseen(models) for effect in free):
            continue
        bias = predicted_bias(models, subject, prices)
        noise = math.sqrt(max(target**2 - bias**2, 0.0))
        samples = prices.samples_for(noise, subject, MOST_SAMPLES)
        ranked.append(models | {"samples": forced.get("samples", samples)})
    return min(ranked, key=rank)


def predicted_bias(models: Mapping[str, Model], subject: Subject, prices: Prices) -> float:
    """Errors of all models, as if they had one sign."""
    effects = ((EFFECTS[name], model) for name, model in models.items())
    return sum(e.error(model, subject, prices) for e, model in effects if e.has_bias)


def predicted_error(models: Mapping[str, Model], subject: Subject, prices: Prices) -> float:
    """Bias of all models and noise together."""
    noise = EFFECTS["samples"].error(models["samples"], subject, prices)
    return math.hypot(predicted_bias(models, subject, prices), noise)


def predicted_seconds(models: Mapping[str, Model], prices: Prices) -> float:
    """Time of a million rays on two cores, forward."""
    return prices.seconds["rays"] + sum(
        EFFECTS[name].seconds(model, prices) for name, model in models.items() if name != "samples"
    )
