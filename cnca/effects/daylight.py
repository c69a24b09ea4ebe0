"""Sun and sky (:mod:`cnca.mi_bridge.light`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from cnca.effects.effect import Effect, Model, left_out
from cnca.effects.subject import Subject
from cnca.scene.weather import Weather


class SunEffect(Effect):
    """The sun: one direction, or a disc whose shadows have soft edges."""

    name = "sun"
    models = ("off", "direction", "disc")
    usual = "direction"
    priced = ("direction",)

    def present(self, subject: Subject) -> tuple[Model, ...]:
        """``off`` below the horizon."""
        return self.models if subject.has_sun else self.models[:1]

    def share(self, model: Model, subject: Subject) -> float:
        """A direction errs only where the sun shines."""
        return float(subject.has_sun) if model == "direction" else 1.0

    def within(self, model: Model, weather: Weather) -> Weather:
        """No sun under ``off``."""
        return replace(weather, sun_scale=0.0) if model == "off" else weather

    def unforeseen(self, models: Mapping[str, Model]) -> bool:
        """Lacquer mirrors a sun without width as rare glints."""
        return models[self.name] == "direction" and models["materials"] == "coat"

    def why(self, model: Model, subject: Subject, error: float) -> str:
        """Where it stands."""
        weather = subject.weather
        place = f"altitude {weather.sun_altitude:g}°, scale {weather.sun_scale:g}"
        if model == "off":
            return f"no light at {place}"
        return f"{place}; {left_out(error) if model == 'direction' else 'soft edges of shadows'}"


class SkyEffect(Effect):
    """The sky, found by rays that the materials choose."""

    name = "sky"
    models = ("off", "map")

    def present(self, subject: Subject) -> tuple[Model, ...]:
        """``off`` where it is black."""
        return self.models if subject.weather.sky_scale > 0 else self.models[:1]

    def within(self, model: Model, weather: Weather) -> Weather:
        """A black sky under ``off``."""
        return replace(weather, sky_scale=0.0) if model == "off" else weather

    def work(self, model: Model) -> dict[str, float]:
        """Every ray that escapes looks the map up: its time is part of the rays'."""
        return {}

    def why(self, model: Model, subject: Subject, error: float) -> str:
        """Which sky it is."""
        if model == "off":
            return "scale 0"
        return f"Hosek–Wilkie, turbidity {subject.weather.turbidity:g}"
