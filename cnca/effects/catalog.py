"""All effects, in the order in which plans list them."""

from __future__ import annotations

from collections.abc import Iterable

from cnca.core.errors import CncaError, did_you_mean
from cnca.effects.caustics import CausticsEffect
from cnca.effects.daylight import SkyEffect, SunEffect
from cnca.effects.effect import Effect, Model
from cnca.effects.estimate import GradientEffect, SamplesEffect
from cnca.effects.fog import FogEffect
from cnca.effects.lamps import LampsEffect
from cnca.effects.subject import Contents
from cnca.effects.surfaces import GlassEffect, InterreflectionEffect, MaterialsEffect
from cnca.effects.wetness import WetnessEffect
from cnca.effects.world import SurroundingsEffect

_ALL: tuple[Effect, ...] = (
    FogEffect(),
    SunEffect(),
    SkyEffect(),
    SurroundingsEffect(),
    LampsEffect(),
    InterreflectionEffect(),
    CausticsEffect(),
    WetnessEffect(),
    MaterialsEffect(),
    GlassEffect(),
    GradientEffect(),
    SamplesEffect(),
)
EFFECTS = {effect.name: effect for effect in _ALL}
"""Name → effect."""


def amounts(contents: Contents) -> dict[str, float]:
    """Effect → how much of it the scene holds."""
    return {name: effect.amount(contents) for name, effect in EFFECTS.items()}


def parse_effects(settings: Iterable[str]) -> dict[str, Model]:
    """``["fog=none", …]`` as a table; raises CncaError for unknown effects and models."""
    forced = {}
    for setting in settings:
        name, _, model = setting.partition("=")
        if name not in EFFECTS:
            hint = did_you_mean(name, EFFECTS)
            raise CncaError(f"effect '{name}': there is {', '.join(EFFECTS)}{hint}")
        forced[name] = EFFECTS[name].parse(model)
    return forced
