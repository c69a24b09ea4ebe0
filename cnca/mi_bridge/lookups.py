"""Pictures as texture look-ups: each view's shading is kept, and a picture takes milliseconds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch

from cnca.core.types import Boxes, LinearImages, LinearTexture, PlainPictures
from cnca.mi_bridge.affine import AffinePicture, look_up
from cnca.mi_bridge.backgrounds import KeptBackgrounds
from cnca.mi_bridge.geometry import ALBEDO_FLOOR
from cnca.mi_bridge.texture_check import refuse_bad_texture
from cnca.scene.cameras import View
from cnca.scene.weather import Weather

Shading = Callable[[View, Weather, LinearTexture], AffinePicture]
"""Shades one view in one weather; interreflections may show the texture."""


@dataclass
class _Kept:
    picture: AffinePicture
    calls: int = 0
    """Renders that it has served."""
    plain: PlainPictures | None = None
    """Made when a residual first asks for it."""

    @property
    def megabytes(self) -> float:
        """Memory that it takes."""
        drawn = 0 if self.plain is None else self.plain.drawn.nbytes
        return self.picture.megabytes + drawn / 1e6


class LookupRenderer:
    """A :class:`cnca.scene.protocols.Renderer` whose pictures are affine in the texture.

    Meant, like :class:`KeptBackgrounds`, for a loop that comes back to the same views.  Pictures
    have no other noise than their shading, which does not change: the seed is without effect.
    """

    def __init__(self, kept: KeptBackgrounds, shading: Shading, refresh: int | None = None) -> None:
        """With ``refresh`` a view is shaded anew, in the present texture, after that many renders.

        A run that is interrupted then does not go on as if it had not been.
        """
        self.kept, self.shading, self.refresh = kept, shading, refresh
        self._kept: dict[tuple[View, Weather], _Kept] = {}

    def render(
        self, albedo: LinearTexture, views: Sequence[View], weather: Weather, *, seed: int
    ) -> LinearImages:
        """Exposed linear images (views, 3, height, width), differentiable in ``albedo``.

        Raises TextureError as :class:`cnca.mi_bridge.renderer.MitsubaRenderer` does.
        """
        refuse_bad_texture(albedo.detach(), self.kept.renderer.texture_size)
        for view in views:  # all of them first: shading lets a traced world go
            self.kept.background(view, weather)
        pictures = [self.picture(view, weather, albedo) for view in views]
        return self._draw(albedo, pictures, views[0])

    def _draw(
        self, albedo: LinearTexture, pictures: Sequence[AffinePicture], view: View
    ) -> LinearImages:
        """All pictures, of the size of ``view``, with one texture."""
        size = self.kept.renderer.geometry.texture_size
        texture = albedo.expand(3, size, size)
        images = look_up(ALBEDO_FLOOR + (1 - ALBEDO_FLOOR) * texture, pictures)
        return LinearImages(images.reshape(-1, view.height, view.width, 3).permute(0, 3, 1, 2))

    def vehicle_boxes(self, views: Sequence[View]) -> Boxes:
        """Bounding boxes (views, 4), xyxy in pixels; see :class:`KeptBackgrounds`."""
        return self.kept.vehicle_boxes(views)

    def reference(
        self, views: Sequence[View], weather: Weather, *, seed: int
    ) -> list[PlainPictures]:
        """The plain paint, path-traced and as :meth:`render` draws it; both are kept."""
        return [self._plain(view, weather) for view in views]

    @torch.no_grad()
    def _plain(self, view: View, weather: Weather) -> PlainPictures:
        kept = self._shaded(view, weather)
        if kept.plain is None:
            drawn = self._draw(self.kept.plain, [kept.picture], view)
            kept.plain = PlainPictures(self.kept.traced(view, weather), drawn)
        return kept.plain

    def picture(self, view: View, weather: Weather, albedo: LinearTexture) -> AffinePicture:
        """What is kept of one view, shaded now if it never was, or too long ago."""
        kept = self._shaded(view, weather)
        if self.refresh is not None and kept.calls >= self.refresh:
            kept = self._kept[view, weather] = _Kept(self.shading(view, weather, albedo))
        kept.calls += 1
        return kept.picture

    def _shaded(self, view: View, weather: Weather) -> _Kept:
        """What is kept of one view, however old; a new one is shaded in the plain paint.

        It does not depend on the step that asks first: a resumed loop finds the same.
        """
        if (view, weather) not in self._kept:
            self._kept[view, weather] = _Kept(self.shading(view, weather, self.kept.plain))
        return self._kept[view, weather]

    @property
    def megabytes(self) -> float:
        """Memory that the kept views take."""
        return self.kept.megabytes + sum(kept.megabytes for kept in self._kept.values())
