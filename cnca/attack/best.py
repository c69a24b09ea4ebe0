"""The best latents so far, by views that neither the attack nor its verdict sees."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from cnca.attack.parts import Attack
from cnca.attack.records import Readings
from cnca.attack.settings import Settings
from cnca.attack.targets import look, readings
from cnca.core import parallel
from cnca.core.color import linear_to_srgb
from cnca.core.errors import NonFiniteError
from cnca.core.types import SrgbTexture
from cnca.gen.latents import Latents
from cnca.world.draw import draw_blocks

VALIDATION_SEED = 7_919
"""Added to a run's seed for the views of the checks."""
WEATHERS, VIEWS = 4, 3
"""How many weathers a check looks at, and how many views in each."""


@dataclass
class Best:
    """The best of the latents that were checked."""

    latents: Latents | None = None
    loss: float = math.inf
    """Its L_adv over the validation views, weighted and summed over the targets."""
    step: int = 0
    misses: int = 0
    """Checks since then."""

    def offer(self, latents: Latents, loss: float, step: int) -> None:
        """Keep these latents if they are the best so far; raises NonFiniteError for NaN or ∞."""
        if not math.isfinite(loss):
            raise NonFiniteError(
                f"check after step {step}: the loss is not finite; --resume tries it again"
            )
        if loss < self.loss:
            self.latents, self.loss, self.step = latents, loss, step
            self.misses = 0
        else:
            self.misses += 1

    def exhausted(self, patience: int) -> bool:
        """Whether that many checks in a row brought no gain; never where ``patience`` is 0."""
        return 0 < patience <= self.misses


class Validation:
    """What a check looks at: always the same views, weathers and noise."""

    def __init__(self, attack: Attack, settings: Settings, text_feature: Tensor) -> None:
        self.attack, self.settings, self.text_feature = attack, settings, text_feature
        self.seed = settings.seed + VALIDATION_SEED
        self.views, self.weathers = draw_blocks(
            attack.scene, WEATHERS * VIEWS, WEATHERS, seed=self.seed
        )

    @torch.no_grad()
    def look(self, latents: Latents) -> Readings:
        """What the targets see of these latents."""
        seed = self.settings.seed
        return self.look_at(self.attack.texture(self.text_feature, latents, seed, together=True))

    @torch.no_grad()
    def look_at(self, texture: SrgbTexture) -> Readings:
        """What the targets see of a texture."""
        attack = self.attack
        albedo = attack.paint.apply(texture)
        seen = torch.zeros(2, len(attack.targets))
        for k in parallel.share(range(WEATHERS)):
            views = self.views[k]
            images = attack.render(albedo, views, self.weathers[k], self.seed)
            boxes = attack.renderer.vehicle_boxes(views)
            seen += look(attack.objective, attack.targets, linear_to_srgb(images), boxes)
        parallel.add_up(seen)
        return readings(attack.targets, seen / WEATHERS)
