"""Pictures in which only the vehicle is rendered anew, over a background that is kept.

The paper composes X = B + X_ren likewise (equations 1 and 2).  What is neglected is the light that
the texture throws on its surroundings: they keep what they had from the plain paint.  The loop
spends its rays on the vehicle's pixels, a small part of the picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import torch
from jaxtyping import Float, Int

from cnca.core.types import Boxes, LinearImages, LinearTexture, PlainPictures
from cnca.mi_bridge.first_look import Background, first_look
from cnca.mi_bridge.portions import vehicle_part
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.scene.cameras import View
from cnca.scene.layers import Sighting
from cnca.scene.weather import Weather

BACKGROUND_SEED = 0x2545F491
"""Seed of every background, whichever step comes upon it first."""

REFERENCE_SAMPLES = 64
"""Rays per pixel of the vehicle in the picture that an EFR learns the weather from."""


class KeptBackgrounds:
    """Renders the vehicle's pixels of each view; a :class:`cnca.scene.protocols.Renderer`.

    The first picture of a view in a weather is rendered whole, in the plain paint, and kept:
    meant for a loop that comes back to the same views.
    """

    def __init__(self, renderer: MitsubaRenderer, plain: LinearTexture) -> None:
        self.renderer, self.plain = renderer, plain
        self._kept: dict[tuple[View, Weather], Background] = {}
        self._references: dict[tuple[View, Weather], torch.Tensor] = {}
        self._boxes: dict[View, torch.Tensor] = {}

    def render(
        self, albedo: LinearTexture, views: Sequence[View], weather: Weather, *, seed: int
    ) -> LinearImages:
        """Exposed linear images (views, 3, height, width), differentiable in ``albedo``."""
        kept = [self.background(view, weather) for view in views]
        height, width = kept[0].image.shape[1:]
        pixels = np.concatenate([k * height * width + b.pixels for k, b in enumerate(kept)])
        vehicle = self._vehicle(albedo, views, weather, kept, pixels, seed=seed)
        background = torch.stack([b.image for b in kept]).permute(0, 2, 3, 1).reshape(-1, 3)
        images = background.index_copy(0, torch.from_numpy(pixels), vehicle)
        return LinearImages(images.reshape(len(views), height, width, 3).permute(0, 3, 1, 2))

    def _vehicle(
        self,
        albedo: LinearTexture,
        views: Sequence[View],
        weather: Weather,
        kept: Sequence[Background],
        pixels: Int[np.ndarray, " pixels"],
        *,
        seed: int,
        samples: int | None = None,
    ) -> Float[torch.Tensor, "pixels 3"]:
        """The pixels that the vehicle touches, of all the views."""
        render = partial(
            self.renderer.render_pixels, albedo, views, weather, pixels, seed=seed, samples=samples
        )
        if self.renderer.worlds is None:
            return render()
        shares = np.concatenate([b.shares for b in kept if b.shares is not None])
        rest = torch.cat([b.rest for b in kept if b.rest is not None])
        return rest + render(portion=vehicle_part(shares))

    def vehicle_boxes(self, views: Sequence[View]) -> Boxes:
        """Bounding boxes (views, 4), xyxy in pixels; see :class:`MitsubaRenderer`."""
        new = [view for view in views if view not in self._boxes]
        if new:
            self._boxes.update(zip(new, self.renderer.vehicle_boxes(new), strict=True))
        return torch.stack([self._boxes[view] for view in views])

    def sightings(self, views: Sequence[View]) -> list[list[Sighting]]:
        """Everything else with a label that each view shows; see :class:`MitsubaRenderer`."""
        return self.renderer.sightings(views)

    def visible_shares(self, views: Sequence[View]) -> list[float]:
        """Share of the vehicle in each view that nothing hides; see :class:`MitsubaRenderer`."""
        return self.renderer.visible_shares(views)

    @torch.no_grad()
    def reference(
        self, views: Sequence[View], weather: Weather, *, seed: int
    ) -> list[PlainPictures]:
        """The vehicle in its plain paint, with the noise of :meth:`render` and without it."""
        drawn = self.render(self.plain, views, weather, seed=seed).split(1)
        traced = [self.traced(view, weather) for view in views]
        return [PlainPictures(*pair) for pair in zip(traced, drawn, strict=True)]

    @torch.no_grad()
    def traced(self, view: View, weather: Weather) -> LinearImages:
        """X_ref, a batch of one: the vehicle in its plain paint by many rays, kept."""
        if (view, weather) not in self._references:
            kept = self.background(view, weather)
            vehicle = self._vehicle(
                self.plain,
                [view],
                weather,
                [kept],
                kept.pixels,
                seed=BACKGROUND_SEED,
                samples=REFERENCE_SAMPLES,
            )
            image = kept.image.permute(1, 2, 0).reshape(-1, 3)
            image = image.index_copy(0, torch.from_numpy(kept.pixels), vehicle)
            image = image.reshape(1, *kept.image.shape[1:], 3).permute(0, 3, 1, 2)
            self._references[view, weather] = image
        return LinearImages(self._references[view, weather])

    @property
    def megabytes(self) -> float:
        """Memory that the kept views take."""
        kept = sum(b.image.nbytes + b.pixels.nbytes for b in self._kept.values())
        return (kept + sum(image.nbytes for image in self._references.values())) / 1e6

    @torch.no_grad()
    def background(self, view: View, weather: Weather) -> Background:
        """What is kept; else it is rendered, alone: a resumed loop finds the same noise."""
        if (view, weather) not in self._kept:
            self._kept[view, weather] = self._render_background(view, weather)
        return self._kept[view, weather]

    def _render_background(self, view: View, weather: Weather) -> Background:
        renderer, seed = self.renderer, BACKGROUND_SEED
        if renderer.worlds is not None:
            return first_look(renderer, self.plain, view, weather, seed=seed)
        image = renderer.render(self.plain, [view], weather, seed=seed)[0]
        pixels = np.flatnonzero(renderer.vehicle_mask([view])[0] > 0)
        return Background(image, pixels)
