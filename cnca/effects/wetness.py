"""A wet ground (:mod:`cnca.mi_bridge.wet`)."""

from __future__ import annotations

from cnca.effects.effect import Effect, Model, left_out
from cnca.effects.subject import Contents, Subject


class WetnessEffect(Effect):
    """Water on the ground: a film that mirrors, darker ground beneath it, puddles."""

    name = "wetness"
    models = ("dry", "film")
    priced = ("dry",)

    def amount(self, contents: Contents) -> float:
        """The scene's ``ground.wetness`` in [0, 1]."""
        return contents.wetness

    def present(self, subject: Subject) -> tuple[Model, ...]:
        """``dry`` where there is no water."""
        return self.models if subject.amounts.get(self.name, 0) > 0 else self.models[:1]

    def share(self, model: Model, subject: Subject) -> float:
        """Dry ground errs in proportion to the water that is left out."""
        return subject.amounts.get(self.name, 0.0) if model == "dry" else 1.0

    def why(self, model: Model, subject: Subject, error: float) -> str:
        """How wet it is."""
        wetness = subject.amounts.get(self.name, 0.0)
        if wetness == 0:
            return "the ground is dry"
        if model == "dry":
            return left_out(error)
        return f"wetness {wetness:g}: a film of water{' and puddles' if wetness > 0.5 else ''}"
