"""What an attack lowers: one file for each objective, each with a class ``Loss``.

The name of a file is short for ``cnca.attack.objectives.NAME:Loss``, so that a new objective is a
new file here, or ``module:attribute`` anywhere else (:mod:`cnca.core.plugins`).
"""

from __future__ import annotations

import pkgutil

from cnca.core.errors import RunError, did_you_mean
from cnca.core.plugins import is_plugin, load_plugin
from cnca.scene.protocols import Objective


def objective_names() -> list[str]:
    """The objectives that come with the program."""
    return sorted(module.name for module in pkgutil.iter_modules(__path__))


def load_objective(spec: str, *, full_overlap: float | None = None) -> Objective:
    """Return the objective called ``spec``; ``full_overlap`` overrides its own value.

    Raises RunError for an unknown name, or an attribute that is no objective.
    """
    names = objective_names()
    options = {} if full_overlap is None else {"full_overlap": full_overlap}
    if spec in names:
        spec = f"{__name__}.{spec}:Loss"
    elif not is_plugin(spec):
        hint = did_you_mean(spec, names)
        raise RunError(
            f"objective '{spec}': unknown; there is {', '.join(names)}, or module:attribute{hint}"
        )
    return load_plugin(spec, Objective, error=RunError, **options)
