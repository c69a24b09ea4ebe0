"""Sun and sky (:mod:`cnca.mi_bridge.light`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from cnca.effects.effect import Effect, Model, left_out
from cnca.effects.subject import Subject
from cnca.scene.environment import read_environment
from cnca.scene.weather import Weather

MOST_CONTRAST = 0.4
"""Contrast up to which rays find a sky by themselves: looking for its lights would not pay off.

Overcast skies have 0.6, those beside a high sun 0.2, lamps at night 40 (``benchmarks/skies.py``).
"""


def contrast(weather: Weather) -> float:
    """That of a measured sky (:class:`cnca.scene.environment.Environment`); the model's is low."""
    return 0.0 if weather.sky_map is None else read_environment(weather.sky_map).contrast


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
        """Lacquer mirrors a sun without width as rare glints, unless these are bounded."""
        glossy = models["materials"] == "coat" and models["caustics"] == "kept"
        return models[self.name] == "direction" and glossy

    def why(self, model: Model, subject: Subject, error: float) -> str:
        """Where it stands."""
        weather = subject.weather
        if weather.sky_map is not None and model == "off":
            return "the sky's map shows no sun"
        place = f"altitude {weather.sun_altitude:g}°, scale {weather.sun_scale:g}"
        if model == "off":
            return f"no light at {place}"
        return f"{place}; {left_out(error) if model == 'direction' else 'soft edges of shadows'}"


class SkyEffect(Effect):
    """The sky, found by rays that the materials choose, and by others sent where it is bright."""

    name = "sky"
    models = ("off", "map", "map_mis")
    unbiased = ("map",)

    def present(self, subject: Subject) -> tuple[Model, ...]:
        """``off`` where it is black; sampled by brightness only where its contrast asks for it."""
        weather = subject.weather
        if weather.sky_scale == 0:
            return self.models[:1]
        return self.models if contrast(weather) > MOST_CONTRAST else self.models[:2]

    def within(self, model: Model, weather: Weather) -> Weather:
        """A black sky under ``off``."""
        return replace(weather, sky_scale=0.0) if model == "off" else weather

    def work(self, model: Model) -> dict[str, float]:
        """Every ray that escapes looks the map up: its time is part of the rays'."""
        return {self.key(model): 1.0} if model == "map_mis" else {}

    def why(self, model: Model, subject: Subject, error: float) -> str:
        """Which sky it is."""
        if model == "off":
            return "scale 0"
        weather = subject.weather
        if weather.sky_map is None:
            return f"Hosek–Wilkie, turbidity {weather.turbidity:g}"
        map_name = f"{Path(weather.sky_map.file).name}, contrast {contrast(weather):.1f}"
        return f"{map_name}: {'its lights are sampled' if model == 'map_mis' else 'smooth enough'}"
