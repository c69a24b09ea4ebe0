"""The renderer that judges: it says which effects it simulates and how, and shows what it sees."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int
from torch import Tensor

from cnca.core.types import LinearImages, LinearTexture
from cnca.effects.plan import Demand, EffectPlan
from cnca.scene.cameras import View
from cnca.scene.layers import Layers
from cnca.scene.protocols import Renderer
from cnca.scene.weather import Weather


@runtime_checkable
class PlanningRenderer(Renderer, Protocol):
    """A renderer that chooses a model for each effect, by what is demanded of its pictures."""

    def render(
        self,
        albedo: LinearTexture,
        views: Sequence[View],
        weather: Weather,
        *,
        seed: int,
        demand: Demand | None = None,
    ) -> LinearImages:
        """Return exposed linear images (views, 3, height, width), differentiable in ``albedo``.

        Args:
            albedo: linear, (3, size, size), in [0, 1].
            demand: which effects to render and how; None is what the renderer was made with.
        """

    def render_pixels(
        self,
        albedo: LinearTexture,
        views: Sequence[View],
        weather: Weather,
        pixels: Int[np.ndarray, " pixels"],
        *,
        seed: int,
        samples: int | None = None,
        demand: Demand | None = None,
        first: int = 0,
    ) -> Float[Tensor, "pixels 3"]:
        """Return only these pixels, counted over views, rows and columns.

        ``samples`` are rays per pixel in place of those that the plan takes; they begin with the
        one of number ``first``.
        """

    def plan(
        self,
        albedo: LinearTexture,
        views: Sequence[View],
        weather: Weather,
        *,
        samples: int | None = None,
        demand: Demand | None = None,
    ) -> EffectPlan:
        """Return which model stands for each effect in these pictures."""

    def layers(self, views: Sequence[View]) -> Layers:
        """Return what each view's camera hits first, whatever texture and weather."""

    def vehicle_mask(self, views: Sequence[View]) -> Float[np.ndarray, "views height width"]:
        """Return the share of each pixel that the vehicle covers, in [0, 1]."""
