"""What a picture costs: each effect's error and milliseconds, and the price of other targets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from cnca.effects.effect import Model
from cnca.effects.explain import explain
from cnca.effects.plan import EffectPlan, predicted_error, predicted_seconds
from cnca.effects.prices import shipped_prices

TARGETS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.4)
"""Errors whose price is shown beside the slider."""


@dataclass(frozen=True)
class EffectCost:
    """One line of the plan."""

    effect: str
    model: Model
    why: str
    error: float
    """Predicted, as :mod:`cnca.effects.prices` counts errors."""
    milliseconds: float
    """Predicted, of the whole picture."""


@dataclass(frozen=True)
class TargetCost:
    """What the cheapest plan under a target error takes."""

    target: float
    error: float
    """Predicted; above the target where that is out of reach."""
    samples: int
    milliseconds: float


def effect_costs(plan: EffectPlan, pixels: int) -> list[EffectCost]:
    """The plan, effect by effect, and then all together, for a picture of so many pixels."""
    whole = milliseconds(plan, pixels)
    return [
        EffectCost(row.effect, row.model, row.why, row.error, round(whole * row.time_share, 2))
        for row in explain(plan)
    ]


def target_costs(planned: Callable[[float], EffectPlan], pixels: int) -> list[TargetCost]:
    """The price of each of :data:`TARGETS`; ``planned`` chooses the plan for one."""
    costs = []
    for target in TARGETS:
        plan = planned(target)
        error = predicted_error(plan.models, plan.subject, shipped_prices())
        costs.append(
            TargetCost(target, round(error, 5), plan.samples, round(milliseconds(plan, pixels), 1))
        )
    return costs


def milliseconds(plan: EffectPlan, pixels: int) -> float:
    """Predicted time of a picture on two cores."""
    seconds = predicted_seconds(plan.models, shipped_prices())
    return 1000 * seconds * pixels * plan.samples / 1e6
