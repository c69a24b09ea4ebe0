"""Caustics: sun and lamps, focused by lacquer and chrome onto matt surfaces."""

from __future__ import annotations

import math

from cnca.effects.effect import Effect, Model, left_out
from cnca.effects.subject import Subject

BOUNDS: dict[str, float | None] = {"off": 1 / math.pi, "regularised": 1.0, "kept": None}
"""Model → the most that a surface which is not seen directly, nor in a mirror, reflects of the sun
towards a point (BSDF times cosine, in 1/sr); white matt card reflects 1/π."""


class CausticsEffect(Effect):
    """Sunlight that reaches a matt surface by way of a glossy one.

    Paths start at the camera, so they find the sun's image in a lacquer by chance: rarely, and then
    very bright.  These are the specks of sunny pictures.  Bounding what such a path may find (the
    idea of path-space regularization: Kaplanyan & Dachsbacher 2013, with a bound in place of a
    wider lobe) takes them away, and the part of the caustic that is brighter than the bound.
    """

    name = "caustics"
    models = tuple(BOUNDS)
    usual = "regularised"
    priced = ("regularised",)

    def present(self, subject: Subject) -> tuple[Model, ...]:
        """None without a sun and without lamps."""
        return self.models if subject.has_sun or _lamps(subject) else self.models[:1]

    def work(self, model: Model) -> dict[str, float]:
        """One comparison at each reflection: its time is part of the rays'."""
        return {}

    def grain(self, model: Model) -> float:
        """Specks, which few rays do not predict."""
        return 1.5 if model == "kept" else 1.0

    def why(self, model: Model, subject: Subject, error: float) -> str:
        """How much of them is kept."""
        if not (subject.has_sun or _lamps(subject)):
            return "no sun that could be focused"
        if model == "kept":
            return "all of them, with the specks of those that few paths find"
        much = "no brighter than white matt card" if model == "off" else "up to a bound"
        return f"{much}; {left_out(error)}" if error else much


def _lamps(subject: Subject) -> bool:
    return subject.weather.lamps_lit and subject.amounts.get("lamps", 0) > 0
