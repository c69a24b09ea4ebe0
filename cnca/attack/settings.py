"""What an attack is given: its settings, and the parts that work together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import torch
from torch import Tensor

from cnca.attack.objectives import paper
from cnca.attack.targets import Target
from cnca.core import parallel
from cnca.core.errors import RunError, did_you_mean
from cnca.core.types import LinearImages, LinearTexture, SrgbTexture
from cnca.gen.feature import CONCAT, UPDATES, check_kind
from cnca.scene.cameras import View
from cnca.scene.paint import Paint
from cnca.scene.protocols import (
    LoopRenderer,
    Objective,
    Renderer,
    Residual,
    TextureGenerator,
)
from cnca.scene.schema import Scene
from cnca.scene.weather import Weather

WEATHERS = 16
"""Weathers that the steps take in turn, as many as the paper's data sets have."""


@dataclass(frozen=True)
class Settings:
    """What the attack is to do."""

    prompt: str
    tau: float = 1.0
    """Bound on each element of F_adv, ≥ 0; ``inf`` for none."""
    steps: int = 100
    views_per_step: int = 8
    view_pool: int = 256
    """Pictures that the steps come back to, so that backends may keep what never changes."""
    learning_rate: float = 0.01
    """Step size; the paper's value."""
    decay: bool = False
    """Let the step size fall to 0 along half a cosine, so that F_adv comes to rest."""
    update: str = "adam"
    """How F_adv moves, a key of :data:`cnca.gen.feature.UPDATES`."""
    check_every: int = 0
    """Steps between checks on validation views, whose best F_adv is the result; 0 for none."""
    patience: int = 0
    """Stop after so many checks in a row without gain; 0 goes on to the end."""
    seed: int = 0
    feature: str = CONCAT
    """What F_adv does to the text: ``concat`` is the paper's, ``replace`` the released code's."""
    start_spread: float | None = None
    """Standard deviation of F_adv at the start; None takes that of the kind of feature."""

    def __post_init__(self) -> None:
        """Raises RunError for counts and sizes that make no attack."""
        for name in ("steps", "views_per_step", "view_pool", "learning_rate"):
            if not getattr(self, name) > 0:
                raise RunError(f"{name} is {getattr(self, name)}: give a number above 0")
        for name in ("check_every", "patience"):
            if getattr(self, name) < 0:
                raise RunError(f"{name} is {getattr(self, name)}: give 0 or more")
        if self.patience and not self.check_every:
            raise RunError(f"patience is {self.patience}: it counts checks; give check_every too")
        check_kind(self.feature)
        if self.update not in UPDATES:
            hint = did_you_mean(self.update, UPDATES)
            raise RunError(f"update '{self.update}': there is {' and '.join(UPDATES)}{hint}")

    @property
    def pool_size(self) -> int:
        """Number of views that the steps come back to: enough for one step in each weather."""
        return max(self.view_pool, WEATHERS * self.views_per_step)

    def step_size(self, step: int) -> float:
        """The step size of step 0, 1, …, ``steps`` − 1."""
        share = 0.5 + 0.5 * math.cos(math.pi * step / self.steps) if self.decay else 1.0
        return share * self.learning_rate

    def checks(self, done: int) -> bool:
        """Whether a check follows when so many steps are done; the last step always has one."""
        return self.check_every > 0 and (done % self.check_every == 0 or done == self.steps)


@dataclass(frozen=True)
class Attack:
    """The parts that work together, and the scene that they work on."""

    scene: Scene
    renderer: Renderer
    paint: Paint
    generator: TextureGenerator
    targets: Sequence[Target]
    """The detectors to fool, one or more."""
    objective: Objective = field(default_factory=paper.Loss)
    """What is lowered of what they see."""
    residual: Residual | None = None

    def texture(
        self, text_feature: Tensor, feature: Tensor, seed: int, *, together: bool = False
    ) -> SrgbTexture:
        """T_adv for one F_adv; the initial noise belongs to the seed and never changes.

        ``together``: all processes of the job call this at once, and divide the work.
        """
        noise = torch.Generator().manual_seed(seed)
        return self.generator.generate(text_feature, feature, noise, together=together)

    def render(
        self, albedo: LinearTexture, views: Sequence[View], weather: Weather, seed: int
    ) -> LinearImages:
        """The images that the detector sees, corrected by the residual where there is one."""
        each = parallel.calls(views, seed)
        return torch.cat([self._draw(albedo, some, weather, own) for some, own in each])

    def _draw(
        self, albedo: LinearTexture, views: Sequence[View], weather: Weather, seed: int
    ) -> LinearImages:
        images = self.renderer.render(albedo, views, weather, seed=seed)
        if self.residual is None:
            return images
        assert isinstance(self.renderer, LoopRenderer)
        return self.residual(images, self.renderer.reference(views, weather, seed=seed))


def prompt_texture(generator: TextureGenerator, prompt: str, seed: int) -> SrgbTexture:
    """What the generator paints with F_adv = 0, from the noise that an attack's seed stands for."""
    noise, nothing = torch.Generator().manual_seed(seed), torch.zeros(generator.feature_shape)
    with torch.no_grad():
        return generator.generate(generator.encode(prompt), nothing, noise)
