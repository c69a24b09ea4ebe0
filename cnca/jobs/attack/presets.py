"""Settings that belong together, by name: what ``--preset`` gives where no flag says otherwise.

Plain data, as the flags of ``cnca optimize`` are called; every flag that is given overrides it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import fields, replace
from typing import Any

from cnca.attack.settings import Settings
from cnca.core.errors import RunError, did_you_mean
from cnca.jobs.attack.request import Request

PRESETS: Mapping[str, Mapping[str, Any]] = {
    # What did best in the runs that were made, few so far (docs/attack.md).
    "best": {
        "variable": "noise",
        "objective": "odds",
        "texture_size": 256,
        "pattern_size": 0.25,
        "ddim_steps": 8,
        "learning_rate": 0.1,
        "decay": True,
        "jitter": True,
        "views_per_step": 12,
        "view_pool": 96,
        "backend": "cached",
        "minutes": 10.0,
    },
    # Sections 3 and 4 of the paper, which are the defaults of the records themselves: F_adv,
    # equation 11, 20 steps of DDIM, Adam with a step of 0.01.
    "paper": {},
}
BEST = "best"
OF_NOISES = ("texture_size", "pattern_size")
"""What presets say of these is meant for the noises of the shipped generator."""


def preset(name: str) -> Mapping[str, Any]:
    """Flag → value; raises RunError for an unknown name."""
    if name not in PRESETS:
        hint = did_you_mean(name, PRESETS)
        raise RunError(f"preset '{name}': unknown; there is {' and '.join(PRESETS)}{hint}")
    return PRESETS[name]


def under_preset(request: Request, name: str = BEST, *, but: Collection[str] = ()) -> Request:
    """``request`` with everything that the preset says, ``but`` for some flags."""
    given = {key: value for key, value in preset(name).items() if key not in but}
    of_settings = {field.name for field in fields(Settings)}
    settings = {key: value for key, value in given.items() if key in of_settings}
    others = {key: value for key, value in given.items() if key not in of_settings}
    return replace(request, settings=replace(request.settings, **settings), **others)
