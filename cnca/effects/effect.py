"""What an effect is: its models, and all that a plan must know of them.

A new effect is a subclass of :class:`Effect` in a file of this folder, its place in
:data:`cnca.effects.catalog.EFFECTS`, and its Mitsuba side.
"""

from __future__ import annotations

from collections.abc import Mapping

from cnca.core.errors import CncaError, did_you_mean
from cnca.effects.prices import Prices
from cnca.effects.subject import Contents, Subject
from cnca.scene.weather import Weather

Model = str | int
"""How an effect is simulated: by a name, or by a number such as that of the reflections."""


class Effect:
    """Something that light does, and the models that stand for it, cheapest first."""

    name: str
    models: tuple[Model, ...]
    """The ladder; the last one is the best."""
    usual: Model | None = None
    """The model without a target error; None is the best that the scene has a use for."""
    priced: tuple[Model, ...] = ()
    """Models whose error ``cnca calibrate`` measures beside the best."""
    unbiased: tuple[Model, ...] = ()
    """Models that have the same mean as the best, and differ from it in noise and time alone."""
    has_bias: bool = True
    """Whether its models err in the mean, so that a target error chooses among them."""

    def amount(self, contents: Contents) -> float:
        """How much of it the scene holds, whatever the weather; 0 where it has none."""
        return 1.0

    def present(self, subject: Subject) -> tuple[Model, ...]:
        """The models that differ in this scene: the cheapest alone where the effect is absent."""
        return self.models

    def share(self, model: Model, subject: Subject) -> float:
        """Closed form of the most that ``model`` can err in this scene; 1 where there is none."""
        return 1.0

    def within(self, model: Model, weather: Weather) -> Weather:
        """The weather without what ``model`` leaves out."""
        return weather

    def unforeseen(self, models: Mapping[str, Model]) -> bool:
        """Whether its model, beside those of other effects, errs in ways that no mean predicts."""
        return False

    def grain(self, model: Model) -> float:
        """Noise of the model over that of the quietest, where no measurement has told it yet."""
        return 1.0

    def why(self, model: Model, subject: Subject, error: float) -> str:
        """Why ``model`` was chosen, for people; ``error`` is the predicted one."""
        return left_out(error)

    def explain(self, model: Model, subject: Subject, error: float, *, by_name: bool) -> str:
        """:meth:`why`, unless the model was asked for by name."""
        return "asked for by name" if by_name else self.why(model, subject, error)

    def work(self, model: Model) -> dict[str, float]:
        """Key in :attr:`Prices.seconds` → how often the model pays that time."""
        return {self.key(model): 1.0} if model != self.models[0] else {}

    @property
    def parts(self) -> list[str]:
        """All keys of :meth:`work`, whose times calibration tells apart."""
        return list(dict.fromkeys(part for model in self.models for part in self.work(model)))

    @property
    def compared(self) -> tuple[Model, ...]:
        """Models that a price list sets beside the usual one."""
        usual = self.models[-1] if self.usual is None else self.usual
        return tuple(m for m in self.models if m in (*self.priced, self.models[-1]) and m != usual)

    def key(self, model: Model) -> str:
        """What the model is called in a list of prices."""
        return f"{self.name}={model}"

    def error(self, model: Model, subject: Subject, prices: Prices) -> float:
        """Predicted error of the model beside the best that the scene has a use for, without noise.

        So ``off`` costs nothing where there is nothing to turn off.
        """
        if model == self.present(subject)[-1]:
            return 0.0
        share, fit = self.share(model, subject), prices.errors.get(self.key(model))
        return 0.0 if fit is None or share == 0 else share * fit.error(subject.features())

    def seconds(self, model: Model, prices: Prices) -> float:
        """Predicted time of a million rays beyond what every ray costs."""
        return sum(n * prices.seconds.get(part, 0.0) for part, n in self.work(model).items())

    def candidates(self, subject: Subject, prices: Prices) -> list[Model]:
        """The best model and those whose error was measured."""
        *lower, best = self.present(subject)
        return [*(model for model in lower if self.key(model) in prices.errors), best]

    def possible(self, model: Model, subject: Subject) -> bool:
        """Whether the scene has a use for the model."""
        return model in self.present(subject)

    def parse(self, text: str) -> Model:
        """The model called ``text``; raises CncaError for another."""
        if text not in self.models:
            models = tuple(str(model) for model in self.models)
            hint = did_you_mean(text, models)
            raise CncaError(f"effect {self.name}={text}: its models are {', '.join(models)}{hint}")
        return text


class Numbered(Effect):
    """An effect whose model is a number; the ladder holds some of them."""

    most: int
    """The largest one."""

    def possible(self, model: Model, subject: Subject) -> bool:
        """Every number is."""
        return True

    def parse(self, text: str) -> Model:
        """The number; raises CncaError for anything but one from 1 to :attr:`most`."""
        if not text.isdecimal() or not 1 <= int(text) <= self.most:
            wanted = f"takes a whole number from 1 to {self.most}"
            raise CncaError(f"effect {self.name}={text}: {wanted}")
        return int(text)


def left_out(error: float) -> str:
    """What a simpler model than the best one costs."""
    return f"the best model would change {error:.2%}"
