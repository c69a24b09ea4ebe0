"""What surfaces do to light: materials, glass, and the light that they throw on each other."""

from __future__ import annotations

from cnca.effects.effect import Effect, Model, Numbered, left_out
from cnca.effects.subject import Contents, Subject, mean_over_area


class InterreflectionEffect(Numbered):
    """Surface reflections of a path; 1 is sun and sky alone."""

    name = "interreflection"
    models = (1, 2, 3, 4, 8)
    usual = 2
    priced = (1, 2, 3, 4)
    most = 64

    def work(self, model: Model) -> dict[str, float]:
        """The same for each reflection after the first."""
        return {self.name: float(int(model) - 1)}

    def why(self, model: Model, subject: Subject, error: float) -> str:
        """What more reflections would add."""
        return f"paths of {model} reflection{'s' if model != 1 else ''}; {left_out(error)}"


class MaterialsEffect(Effect):
    """The gloss of the vehicle's materials and the clear coat on its paint."""

    name = "materials"
    models = ("diffuse", "principled", "coat")
    priced = ("principled", "diffuse")

    def amount(self, contents: Contents) -> float:
        """Mean clear coat in [0, 1]."""
        return mean_over_area(contents.vehicle, lambda material: material.clearcoat)

    def present(self, subject: Subject) -> tuple[Model, ...]:
        """No coat where there is none."""
        return self.models if subject.amounts[self.name] > 0 else self.models[:2]

    def share(self, model: Model, subject: Subject) -> float:
        """A principled material errs by its coat."""
        return subject.amounts[self.name] if model == "principled" else 1.0

    def why(self, model: Model, subject: Subject, error: float) -> str:
        """What is left out, if anything."""
        return left_out(error) if error else "all that the vehicle's materials have"


class GlassEffect(Effect):
    """Windows: dark, or thin panes that paths and sunlight pass."""

    name = "glass"
    models = ("dark", "pane")
    priced = ("dark",)

    def amount(self, contents: Contents) -> float:
        """Mean transmission in [0, 1]."""
        return mean_over_area(contents.vehicle, lambda material: material.transmission)

    def present(self, subject: Subject) -> tuple[Model, ...]:
        """``dark`` where no window lets light through."""
        return self.models if subject.amounts[self.name] != 0 else self.models[:1]

    def share(self, model: Model, subject: Subject) -> float:
        """Dark windows err by what they let through."""
        return subject.amounts[self.name] if model == "dark" else 1.0

    def why(self, model: Model, subject: Subject, error: float) -> str:
        """What is left out, if anything."""
        if error:
            return left_out(error)
        if model == "dark":
            return "no window lets light through"
        return "windows that one sees through"
