"""Lamps of a world (:mod:`cnca.mi_bridge.lamps`)."""

from __future__ import annotations

from dataclasses import replace

from cnca.effects.effect import Effect, Model
from cnca.effects.subject import Contents, Subject
from cnca.scene.weather import Weather


class LampsEffect(Effect):
    """Street lamps, lights of traffic and lit windows, where a world has some and they are on."""

    name = "lamps"
    models = ("off", "sampled")
    priced = ("off",)

    def amount(self, contents: Contents) -> float:
        """How many lamps there are."""
        return 0.0 if contents.world is None else float(contents.world.lamp_count)

    def present(self, subject: Subject) -> tuple[Model, ...]:
        """``off`` without lamps, and by day."""
        lit = subject.weather.lamps_lit and subject.amounts.get(self.name, 0) > 0
        return self.models if lit else self.models[:1]

    def within(self, model: Model, weather: Weather) -> Weather:
        """All lamps off under ``off``."""
        return replace(weather, lamps="off") if model == "off" else weather

    def why(self, model: Model, subject: Subject, error: float) -> str:
        """Whether there are any, and who turned them on."""
        count = subject.amounts.get(self.name, 0)
        if count == 0:
            return "nothing around the vehicle shines"
        weather = subject.weather
        if not weather.lamps_lit:
            return "turned off" if weather.lamps == "off" else "the sun is up"
        on = "turned on" if weather.lamps == "on" else "the sun is down"
        chosen = "one is drawn for each surface, by its light there"
        return f"{on}, {count:g} of them: {chosen if model != 'off' else 'left out'}"
