"""Fog between camera, vehicle and sky (:mod:`cnca.mi_bridge.fog`)."""

from __future__ import annotations

import math
from dataclasses import replace

from cnca.effects.effect import Effect, Model
from cnca.effects.subject import Subject
from cnca.scene.weather import Weather

LIGHT = {
    "airlight": "one color instead of what droplets scatter",
    "single": "light that droplets scatter once",
    "field": "solved once, then looked up",
}


def fog_share(subject: Subject) -> float:
    """Most that fog can change: the share it takes of the view and of the sun's slant path."""
    fog = subject.weather.fog
    if fog is None:
        return 0.0
    slant = fog.height / max(math.sin(math.radians(subject.weather.sun_altitude)), 1e-4)
    length = subject.fog_path + (slant if subject.has_sun else fog.height)
    return -math.expm1(-fog.extinction * length) if fog.height > 0 else 0.0


class FogEffect(Effect):
    """A layer of droplets."""

    name = "fog"
    models = ("none", "airlight", "single", "field")
    priced = ("none", "airlight", "single")

    def present(self, subject: Subject) -> tuple[Model, ...]:
        """``none`` where the layer is missing or has no height."""
        return self.models if subject.has_fog else self.models[:1]

    def share(self, model: Model, subject: Subject) -> float:
        """What the layer takes of the light."""
        return 1.0 if model == "field" else fog_share(subject)

    def within(self, model: Model, weather: Weather) -> Weather:
        """Clear air under ``none``."""
        return replace(weather, fog=None) if model == "none" else weather

    def why(self, model: Model, subject: Subject, error: float) -> str:
        """The layer, and what is known of its light."""
        fog = subject.weather.fog
        if fog is None:
            return "the scene has no fog"
        if not subject.has_fog:
            return "the layer has no height"
        layer = f"visibility {fog.visibility:g} m, up to {fog.height:g} m"
        if model == "none":
            return f"{layer}: takes at most {fog_share(subject):.2%} of the light"
        return f"{layer}: {LIGHT[str(model)]}"
