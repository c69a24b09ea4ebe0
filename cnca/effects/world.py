"""What stands around the vehicle: how much of it takes part in the light."""

from __future__ import annotations

from cnca.effects.effect import Effect, Model
from cnca.effects.prices import Prices
from cnca.effects.subject import Contents, Subject

GEOMETRY = "geometry"


class SurroundingsEffect(Effect):
    """The world's light on the vehicle; what stands in front of it hides it on every rung.

    Pictures of the world itself are always traced; the lower rungs are for the vehicle's pixels, of
    which a loop renders many over a picture that it keeps.
    """

    name = "surroundings"
    models = ("none", "backdrop", "probe", GEOMETRY)
    priced = ("backdrop", "probe")

    def amount(self, contents: Contents) -> float:
        """1 where there is a world."""
        return float(contents.world is not None)

    def present(self, subject: Subject) -> tuple[Model, ...]:
        """Without a world there is nothing to choose."""
        return self.models[1:] if subject.amounts.get(self.name) else self.models[:1]

    @property
    def compared(self) -> tuple[Model, ...]:
        """None: whole pictures are traced on every rung."""
        return ()

    def candidates(self, subject: Subject, prices: Prices) -> list[Model]:
        """The best one alone, likewise."""
        return [self.present(subject)[-1]]

    def why(self, model: Model, subject: Subject, error: float) -> str:
        """What the model does."""
        return {
            "none": "the vehicle stands alone on the ground",
            "backdrop": "the world is seen, but neither lights nor shades the vehicle",
            "probe": "the world's light is a panorama and a map of its shadows, kept",
            GEOMETRY: "every path meets the world itself",
        }[str(model)]
