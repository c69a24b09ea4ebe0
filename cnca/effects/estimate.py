"""How the picture is estimated: rays per pixel, and whether the texture's gradient is asked for."""

from __future__ import annotations

from cnca.effects.effect import Effect, Model, Numbered
from cnca.effects.prices import Prices
from cnca.effects.subject import Subject


class GradientEffect(Effect):
    """The derivative of the picture in the texture."""

    name = "gradient"
    models = ("off", "texture")
    has_bias = False

    def work(self, model: Model) -> dict[str, float]:
        """Prices are those of the picture alone."""
        return {}

    def explain(self, model: Model, subject: Subject, error: float, *, by_name: bool) -> str:
        """Whoever renders a picture names it, not the user."""
        return "nobody asks for one" if model == "off" else "nothing else is optimized"


class SamplesEffect(Numbered):
    """Rays per pixel: their error is noise, and the time that every ray costs is theirs."""

    name = "samples"
    models = (16,)
    usual = 16
    most = 65536
    has_bias = False

    def error(self, model: Model, subject: Subject, prices: Prices) -> float:
        """Predicted noise."""
        return prices.noise_of(int(model), subject)

    def work(self, model: Model) -> dict[str, float]:
        """What every ray costs."""
        return {"rays": 1.0}

    def why(self, model: Model, subject: Subject, error: float) -> str:
        """Their number."""
        return f"noise of {model} rays per pixel"
