"""The parts that work together in an attack."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import torch
from torch import Tensor

from cnca.attack.objectives import paper
from cnca.attack.style import Style
from cnca.attack.targets import Target
from cnca.core import parallel
from cnca.core.types import LinearImages, LinearTexture, SrgbTexture
from cnca.gen.latents import Latents
from cnca.scene.cameras import View
from cnca.scene.paint import Paint
from cnca.scene.protocols import LoopRenderer, Objective, Residual, TextureGenerator
from cnca.scene.schema import Scene
from cnca.scene.weather import Weather


@dataclass(frozen=True)
class Attack:
    """The parts that work together, and the scene that they work on."""

    scene: Scene
    renderer: LoopRenderer
    paint: Paint
    generator: TextureGenerator
    targets: Sequence[Target]
    """The detectors to fool, one or more."""
    objective: Objective = field(default_factory=paper.Loss)
    """What is lowered of what they see."""
    residual: Residual | None = None
    style: Style | None = None
    """What is lowered beside it, so that the texture keeps its prompt."""

    def texture(
        self, text_feature: Tensor, latents: Latents, seed: int, *, together: bool = False
    ) -> SrgbTexture:
        """T_adv; what is drawn of noise belongs to the seed and never changes.

        ``together``: all processes of the job call this at once, and divide the work.
        """
        return latents.paint(self.generator, text_feature, seed, together=together)

    def render(
        self, albedo: LinearTexture, views: Sequence[View], weather: Weather, seed: int
    ) -> LinearImages:
        """The images that the detector sees, corrected by the residual where there is one."""
        calls = parallel.calls(views, seed)
        return LinearImages(
            torch.cat([self._draw(albedo, part, weather, part_seed) for part, part_seed in calls])
        )

    def _draw(
        self, albedo: LinearTexture, views: Sequence[View], weather: Weather, seed: int
    ) -> LinearImages:
        images = self.renderer.render(albedo, views, weather, seed=seed)
        if self.residual is None:
            return images
        return self.residual(images, self.renderer.reference(views, weather, seed=seed))


def prompt_texture(generator: TextureGenerator, prompt: str, seed: int) -> SrgbTexture:
    """What the generator paints with F_adv = 0, from the noise that an attack's seed stands for."""
    return Latents(torch.zeros(generator.feature_shape)).texture(generator, prompt, seed)
