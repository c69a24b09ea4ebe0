"""Pictures as texture look-ups: each view's shading is kept, and a picture takes milliseconds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from cnca.mi_bridge.affine import AffinePicture, look_up
from cnca.mi_bridge.backgrounds import KeptBackgrounds
from cnca.mi_bridge.geometry import ALBEDO_FLOOR
from cnca.mi_bridge.renderer import refuse_bad_texture
from cnca.scene.cameras import View
from cnca.scene.weather import Weather
from cnca.types import Boxes, LinearImages, LinearTexture

Shading = Callable[[View, Weather, LinearTexture], AffinePicture]
"""Shades one view in one weather; interreflections may show the texture."""


@dataclass
class _Kept:
    picture: AffinePicture
    calls: int = 0
    """Renders that it has served."""


class LookupRenderer:
    """A :class:`cnca.protocols.Renderer` whose pictures are affine in the texture.

    Meant, as :class:`KeptBackgrounds`, for a loop that comes back to the same views.  Pictures have
    no other noise than their shading, which does not change: the seed is without effect.
    """

    def __init__(self, kept: KeptBackgrounds, shading: Shading, refresh: int | None = None):
        """With ``refresh`` a view is shaded anew, in the present texture, after so many renders.

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
        renderer = self.kept.renderer
        refuse_bad_texture(albedo.detach(), renderer.texture_size)
        pictures = [self.picture(view, weather, albedo) for view in views]
        size = renderer.geometry.texture_size
        texture = albedo.expand(3, size, size)
        images = look_up(ALBEDO_FLOOR + (1 - ALBEDO_FLOOR) * texture, pictures)
        height, width = views[0].height, views[0].width
        return images.reshape(len(views), height, width, 3).permute(0, 3, 1, 2)

    def vehicle_boxes(self, views: Sequence[View]) -> Boxes:
        """Bounding boxes (views, 4), xyxy in pixels; see :class:`KeptBackgrounds`."""
        return self.kept.vehicle_boxes(views)

    def reference(self, views: Sequence[View], weather: Weather) -> LinearImages:
        """X_ref, path-traced; see :meth:`KeptBackgrounds.reference`."""
        return self.kept.reference(views, weather)

    def picture(self, view: View, weather: Weather, albedo: LinearTexture) -> AffinePicture:
        """What is kept of one view, shaded now if it never was, or too long ago."""
        kept = self._kept.get((view, weather))
        if kept is None:
            # In the plain paint, whichever step comes upon it: a resumed loop finds the same.
            kept = _Kept(self.shading(view, weather, self.kept.plain))
        elif self.refresh is not None and kept.calls >= self.refresh:
            kept = _Kept(self.shading(view, weather, albedo))
        kept.calls += 1
        self._kept[view, weather] = kept
        return kept.picture

    @property
    def megabytes(self) -> float:
        """Memory that the kept views take."""
        return sum(kept.picture.megabytes for kept in self._kept.values())
