"""Which models to try in a scene in which something was measured.

The price list proposes (:mod:`cnca.effects.prices`), and what was measured in the scene corrects
it: what was tried is not proposed again, and the list's errors are scaled to those found here.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence

from cnca.effects.catalog import EFFECTS
from cnca.effects.effect import Model
from cnca.effects.plan import predicted_bias, predicted_seconds
from cnca.effects.prices import Prices
from cnca.effects.subject import Subject

Models = Mapping[str, Model]
"""Effect → model, of the effects that have a bias."""


def best_models(subject: Subject, forced: Models) -> dict[str, Model]:
    """The best that the scene has a use for, except for what is asked for by name."""
    best = {name: e.present(subject)[-1] for name, e in EFFECTS.items() if e.has_bias}
    return best | {name: model for name, model in forced.items() if name in best}


def relative_cost(
    models: Models, prices: Prices, noise: float, bias: float, target: float
) -> float:
    """Time of a picture under the target, up to a factor; infinite where the bias is too large.

    Args:
        noise: of that many rays, the same for all that are compared.
        bias, target: errors, as prices have them.
    """
    room = target**2 - bias**2
    grain = math.prod(EFFECTS[name].grain(model) for name, model in models.items())
    time = predicted_seconds(models, prices) * (grain * noise) ** 2
    return time / room if room > 0 else math.inf


def propose(
    subject: Subject,
    target: float,
    *,
    free: Sequence[str],
    forced: Models,
    prices: Prices,
    scale: float = 1.0,
    tried: Sequence[Models] = (),
) -> dict[str, Model] | None:
    """The cheapest models that may stay under the target and were not tried; None: there are none.

    Args:
        free: effects whose model may be exchanged; all others have their best.
        scale: measured over predicted bias, in this scene.
    """
    best = best_models(subject, forced)
    options = {
        name: EFFECTS[name].candidates(subject, prices)
        if name in free and name not in forced
        else [model]
        for name, model in best.items()
    }
    ranked = []
    for combination in itertools.product(*options.values()):
        models = dict(zip(options, combination, strict=True))
        if models in tried or any(EFFECTS[name].unforeseen(models) for name in free):
            continue
        bias = scale * predicted_bias(models, subject, prices)
        ranked.append((relative_cost(models, prices, 1.0, bias, target), models))
    cost, models = min(ranked, key=lambda pair: pair[0], default=(math.inf, best))
    return models if cost < math.inf else None
