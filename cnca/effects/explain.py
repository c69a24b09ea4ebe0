"""A plan in words and numbers: what stands for each effect, why, and what it costs."""

from __future__ import annotations

from dataclasses import dataclass

from cnca.effects.catalog import EFFECTS
from cnca.effects.effect import Model
from cnca.effects.plan import EffectPlan, predicted_error, predicted_seconds
from cnca.effects.prices import Prices, shipped_prices


@dataclass(frozen=True)
class Explanation:
    """One effect's part of a plan."""

    effect: str
    """``all`` for the whole plan."""
    model: Model
    why: str
    error: float
    """Predicted, as :mod:`cnca.effects.prices` counts errors."""
    time_share: float
    """Predicted share of the picture's time; what every ray costs is the samples'."""


def explain(plan: EffectPlan, prices: Prices | None = None) -> list[Explanation]:
    """One record for each effect, and one that holds the whole error."""
    prices = prices or shipped_prices()
    total = predicted_seconds(plan.models, prices)
    rows = []
    for name, effect in EFFECTS.items():
        model, subject = plan[name], plan.subject
        error = effect.error(model, subject, prices)
        by_name = plan.demand.forced.get(name) == model
        why = effect.explain(model, subject, error, by_name=by_name)
        best = effect.present(subject)[-1]
        known = model in (best, *effect.unbiased) or effect.key(model) in prices.errors
        if effect.has_bias and not known:
            why += "; its error was never measured and is not counted"
        share = effect.seconds(model, prices) / total
        rows.append(Explanation(name, model, why, round(error, 6), round(share, 4)))
    error, target = predicted_error(plan.models, plan.subject, prices), plan.demand.target_error
    why = "bias of the models and noise"
    if target is not None:
        why += f", {'under' if error <= target else 'OVER'} the target of {target:.2%}"
    return [*rows, Explanation("all", "", why, round(error, 6), 1.0)]
