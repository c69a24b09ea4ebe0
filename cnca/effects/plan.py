"""Which effects a scene calls for: what is rendered how, and why.

A scene names no models.  :func:`plan` chooses one for each effect: the usual ones, the full
simulation, or, for a target error, the cheapest combination whose predicted error lies under it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from cnca.core.errors import CncaError, did_you_mean
from cnca.effects.prices import Prices, Subject, shipped_prices
from cnca.scene.weather import Weather

LADDERS = {
    "fog": ("none", "airlight", "single", "field"),
    "sun": ("off", "direction", "disc"),
    "sky": ("off", "map"),
    "interreflection": ("1", "2", "3", "4", "8"),
    "materials": ("diffuse", "principled", "coat"),
    "glass": ("dark", "pane"),
    "gradient": ("off", "texture"),
    "samples": ("16",),
}
"""Effect → its models, cheapest first; reflections and rays per pixel may be any number ≥ 1."""
NUMBERS = {"interreflection": 64, "samples": 65536}
"""Effects whose model is a number, and the largest one."""
USUAL = {"sun": "direction", "interreflection": "2", "samples": "16"}
"""Models without a target error; other effects take their best."""
REFERENCE_SAMPLES = "1024"
FOG_LIGHT = {
    "airlight": "one colour instead of what droplets scatter",
    "single": "light that droplets scatter once",
    "field": "solved once, then looked up",
}
GLASS = {"dark": "no window lets light through", "pane": "windows that one sees through"}
Row = dict[str, str | float]
MOST_SAMPLES = 4096
"""Rays per pixel beyond which a target error counts as out of reach."""


@dataclass(frozen=True)
class Demand:
    """What is asked of a picture."""

    target_error: float | None = None
    """Error to stay under (see :mod:`cnca.effects.prices`); None takes the usual models."""
    reference: bool = False
    """Full simulation."""
    forced: Mapping[str, str] = field(default_factory=dict)
    """Effect → model, whatever else would be chosen."""
    usual: Mapping[str, str] = field(default_factory=dict)
    """Effect → model that stands for the entry in :data:`USUAL`."""

    def __post_init__(self) -> None:
        if self.target_error is not None and not 0 < self.target_error < math.inf:
            raise CncaError(f"target error {self.target_error:g}: must be above 0, such as 0.02")


@dataclass(frozen=True)
class EffectPlan:
    """One model for each effect."""

    models: Mapping[str, str]
    subject: Subject
    demand: Demand

    def __getitem__(self, effect: str) -> str:
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
        return replace(
            weather,
            fog=None if self["fog"] == "none" else weather.fog,
            sun_scale=0.0 if self["sun"] == "off" else weather.sun_scale,
            sky_scale=0.0 if self["sky"] == "off" else weather.sky_scale,
        )


def parse_effects(settings: Iterable[str]) -> dict[str, str]:
    """``["fog=none", …]`` as a table; raises CncaError for unknown effects and models."""
    forced = {}
    for setting in settings:
        effect, _, model = setting.partition("=")
        if effect not in LADDERS:
            hint = did_you_mean(effect, LADDERS)
            raise CncaError(f"effect '{effect}': there is {', '.join(LADDERS)}{hint}")
        if effect in NUMBERS:
            most = NUMBERS[effect]
            if not model.isdecimal() or not 1 <= int(model) <= most:
                raise CncaError(f"effect {effect}={model}: takes a whole number from 1 to {most}")
        elif model not in LADDERS[effect]:
            hint = did_you_mean(model, LADDERS[effect])
            models = ", ".join(LADDERS[effect])
            raise CncaError(f"effect {effect}={model}: its models are {models}{hint}")
        forced[effect] = model
    return forced


def plan(subject: Subject, demand: Demand, prices: Prices | None = None) -> EffectPlan:
    """Choose a model for each effect.

    With a target error this is the cheapest combination of models and samples with

        (sum of the models' errors)² + noise² ≤ target²,

    all predicted by ``prices`` (by default those that ship).
    """
    present = {effect: _present(effect, subject) for effect in LADDERS}

    def possible(models: Mapping[str, str]) -> dict[str, str]:
        return {e: m for e, m in models.items() if e in NUMBERS or m in present[e]}

    forced = possible(demand.forced)
    models = {effect: ladder[-1] for effect, ladder in present.items()}
    if demand.reference:
        models["samples"] = REFERENCE_SAMPLES
    else:
        models |= possible(USUAL | dict(demand.usual))
        if demand.target_error is not None:
            target, prices = demand.target_error, prices or shipped_prices()
            models |= _cheapest(subject, target, forced, prices)
    return EffectPlan(models | forced, subject, demand)


def _present(effect: str, subject: Subject) -> tuple[str, ...]:
    """The models of what is in the scene at all."""
    ladder = LADDERS[effect]
    if effect == "fog" and not subject.has_fog:
        return ladder[:1]
    if effect == "sun" and not subject.has_sun:
        return ladder[:1]
    if effect == "sky" and subject.weather.sky_scale == 0:
        return ladder[:1]
    if effect == "materials" and subject.coat == 0:
        return ladder[:2]
    if effect == "glass" and subject.glass == 0:
        return ladder[:1]
    return ladder


def _cheapest(
    subject: Subject, target: float, forced: Mapping[str, str], prices: Prices
) -> dict[str, str]:
    """Models and samples; where the target is out of reach, those with the smallest error."""
    options = {
        effect: (forced[effect],) if effect in forced else _candidates(effect, subject, prices)
        for effect in ("fog", "sun", "interreflection", "materials", "glass")
    }

    def rank(models: dict[str, str]) -> tuple[float, float]:
        error, samples = predicted_error(models, subject, prices), int(models["samples"])
        return max(error, target), samples * predicted_seconds(models, prices)

    every = [dict(zip(options, m, strict=True)) for m in itertools.product(*options.values())]
    ranked = []
    for models in [m for m in every if "sun" in forced or not _glints(m)]:
        bias = sum(prices.error(e, m, subject) for e, m in models.items())
        noise = math.sqrt(max(target**2 - bias**2, 0.0))
        samples = prices.samples_for(noise, subject, MOST_SAMPLES)
        ranked.append(models | {"samples": forced.get("samples", str(samples))})
    return min(ranked, key=rank)


def _glints(models: Mapping[str, str]) -> bool:
    """Lacquer mirrors a sun without width as rare glints, which the fits' means do not foretell."""
    return (models["sun"], models["materials"]) == ("direction", "coat")


def _candidates(effect: str, subject: Subject, prices: Prices) -> list[str]:
    """The best model and those whose error was measured; none was with a sun that is put out."""
    *lower, best = _present(effect, subject)
    return [*(model for model in lower if f"{effect}={model}" in prices.errors), best]


def predicted_error(models: Mapping[str, str], subject: Subject, prices: Prices) -> float:
    """Bias of all models and noise together."""
    bias = sum(prices.error(effect, model, subject) for effect, model in models.items())
    return math.hypot(bias, prices.noise_of(int(models["samples"]), subject))


def predicted_seconds(models: Mapping[str, str], prices: Prices) -> float:
    """Time of a million rays on two cores, forward."""
    return prices.seconds["rays"] + sum(_seconds(e, m, prices) for e, m in models.items())


def _seconds(effect: str, model: str, prices: Prices) -> float:
    if effect == "interreflection":
        return (int(model) - 1) * prices.seconds[effect]
    return prices.seconds.get(f"{effect}={model}", 0.0)


def explain(plan: EffectPlan, prices: Prices | None = None) -> list[Row]:
    """One row for each effect: effect, model, why, predicted error and share of the time.

    The row ``all`` holds the whole error; the time that every ray costs is the row ``samples``.
    """
    prices = prices or shipped_prices()
    total = predicted_seconds(plan.models, prices)
    rows: list[Row] = []
    for effect in LADDERS:
        model = plan[effect]
        error, seconds = prices.error(effect, model, plan.subject), _seconds(effect, model, prices)
        if effect == "samples":
            error, seconds = prices.noise_of(plan.samples, plan.subject), prices.seconds["rays"]
        why = _why(effect, plan, error)
        has_error = effect not in ("gradient", "samples")
        if has_error and model not in _candidates(effect, plan.subject, prices):
            why += "; its error was never measured and is not counted"
        share = round(seconds / total, 4)
        rows.append(_row(effect, model, why, error, share))
    error, target = predicted_error(plan.models, plan.subject, prices), plan.demand.target_error
    why = "bias of the models and noise"
    if target is not None:
        why += f", {'under' if error <= target else 'OVER'} the target of {target:.2%}"
    return [*rows, _row("all", "", why, error, 1.0)]


def _row(effect: str, model: str, why: str, error: float, share: float) -> Row:
    error = round(error, 6)
    return {"effect": effect, "model": model, "why": why, "error": error, "time_share": share}


def _why(effect: str, plan: EffectPlan, error: float) -> str:
    model, weather = plan[effect], plan.subject.weather
    if effect == "gradient":
        return "nobody asks for one" if model == "off" else "nothing else is optimized"
    if plan.demand.forced.get(effect) == model:
        return "asked for by name"
    left_out = f"the best model would change {error:.2%}"
    if effect == "fog":
        if weather.fog is None:
            return "the scene has no fog"
        layer = f"visibility {weather.fog.visibility:g} m, up to {weather.fog.height:g} m"
        if not plan.subject.has_fog:
            return "the layer has no height"
        if model == "none":
            return f"{layer}: takes at most {plan.subject.fog_share:.2%} of the light"
        return f"{layer}: {FOG_LIGHT[model]}"
    if effect == "sun":
        place = f"altitude {weather.sun_altitude:g}°, scale {weather.sun_scale:g}"
        if model == "off":
            return f"no light at {place}"
        return f"{place}; {left_out if model == 'direction' else 'soft edges of shadows'}"
    if effect == "sky":
        return f"Hosek–Wilkie, turbidity {weather.turbidity:g}" if model == "map" else "scale 0"
    if effect == "interreflection":
        return f"paths of {model} reflection{'s' if model != '1' else ''}; {left_out}"
    if effect == "materials":
        return left_out if error else "all that the vehicle's materials have"
    if effect == "glass":
        return left_out if error else GLASS[model]
    return f"noise of {model} rays per pixel"
