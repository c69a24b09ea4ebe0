"""What an attack is to do; plain data, so that the command line makes its flags from it at once."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from cnca.core.errors import RunError, did_you_mean
from cnca.core.options import COST, STRENGTH, Flag
from cnca.gen.choices import CONCAT, UPDATE_NAMES, check_kind

FEATURE, NOISE, BOTH = "feature", "noise", "both"
VARIABLES = (FEATURE, NOISE, BOTH)
"""What an attack may move; see :mod:`cnca.attack.variables`."""
BOUNDS = {FEATURE: 1.0, NOISE: math.inf}
"""Bound τ on how far each element of a variable moves, where the settings say none."""

WEATHERS = 16
"""Weathers that the steps take in turn, as many as the paper's data sets have."""


@dataclass(frozen=True)
class Settings:
    """What the attack is to do; a new flag of ``cnca optimize`` is one field here."""

    prompt: Annotated[str, Flag("What the paint is to look like.")]
    tau: float | None = None
    """Bound on how far each element of a variable moves, ≥ 0; ``inf`` for none; None takes that of
    the variable (:data:`BOUNDS`)."""
    variable: Annotated[
        str, Flag("What is moved: feature (F_adv, the paper), noise, or both.", STRENGTH)
    ] = FEATURE
    """One of :data:`VARIABLES`."""
    steps: Annotated[int, Flag("Updates of what is moved; --minutes decides them.", STRENGTH)] = 100
    views_per_step: Annotated[int, Flag("Pictures per update.", STRENGTH)] = 8
    view_pool: int = 256
    """Pictures that the steps come back to, so that backends may keep what never changes."""
    learning_rate: Annotated[float, Flag("Step size; the paper's is 0.01.", STRENGTH)] = 0.01
    decay: Annotated[bool, Flag("Let it fall to 0 along a cosine.", STRENGTH)] = False
    """So that F_adv comes to rest."""
    update: Annotated[str, Flag("adam, or sign for signed steps.", STRENGTH)] = "adam"
    """How F_adv moves, one of :data:`cnca.gen.choices.UPDATE_NAMES`."""
    check_every: Annotated[
        int, Flag("Steps between checks on views of their own; keeps the best F_adv.", STRENGTH)
    ] = 0
    """0 for no checks: the last F_adv is the result."""
    patience: Annotated[
        int, Flag("Stop after so many checks in a row without gain; 0 never stops.", COST)
    ] = 0
    jitter: Annotated[
        bool, Flag("Shift and scale the pictures in the loop a little.", STRENGTH)
    ] = False
    """See :mod:`cnca.attack.jitter`."""
    seed: Annotated[int, Flag("Seed of everything random.")] = 0
    feature: Annotated[
        str, Flag("concat (the paper) or replace (its released code).", STRENGTH)
    ] = CONCAT
    """What F_adv does to the text."""
    start_spread: float | None = None
    """Standard deviation of F_adv at the start; None takes that of the kind of feature."""

    def __post_init__(self) -> None:
        """Raises RunError for counts and sizes that make no attack."""
        for name in ("steps", "views_per_step", "view_pool", "learning_rate"):
            if not getattr(self, name) > 0:
                raise RunError(f"{name} is {getattr(self, name)}: give a number above 0")
        for name in ("check_every", "patience"):
            if getattr(self, name) < 0:
                raise RunError(f"{name} is {getattr(self, name)}: give 0 or more")
        if self.patience and not self.check_every:
            raise RunError(f"patience is {self.patience}: it counts checks; give check_every too")
        check_kind(self.feature)
        if self.variable not in VARIABLES:
            hint = did_you_mean(self.variable, VARIABLES)
            raise RunError(f"variable '{self.variable}': there is {', '.join(VARIABLES)}{hint}")
        if self.update not in UPDATE_NAMES:
            hint = did_you_mean(self.update, UPDATE_NAMES)
            raise RunError(f"update '{self.update}': there is {' and '.join(UPDATE_NAMES)}{hint}")

    def bound(self, variable: str) -> float:
        """The bound τ of ``feature`` or ``noise``."""
        return BOUNDS[variable] if self.tau is None else self.tau

    @property
    def weathers(self) -> int:
        """Number of weathers that the steps take in turn; fewer where the pool is small."""
        return min(WEATHERS, max(1, self.view_pool // self.views_per_step))

    @property
    def pool_size(self) -> int:
        """Number of views that the steps come back to: enough for one step in each weather."""
        return max(self.view_pool, self.weathers * self.views_per_step)

    def step_size(self, step: int) -> float:
        """The step size of step 0, 1, …, ``steps`` − 1."""
        share = 0.5 + 0.5 * math.cos(math.pi * step / self.steps) if self.decay else 1.0
        return share * self.learning_rate

    def checks(self, done: int) -> bool:
        """Whether a check follows when so many steps are done; the last step always has one."""
        return self.check_every > 0 and (done % self.check_every == 0 or done == self.steps)
