"""Views, weathers and places drawn together: what a run looks at, and what judges it."""

from __future__ import annotations

from collections.abc import Sequence

from cnca.core.errors import SceneError
from cnca.scene.cameras import Spot, View
from cnca.scene.schema import Scene
from cnca.scene.variation import draw_spots, draw_views, draw_weathers, in_blocks
from cnca.scene.weather import Weather
from cnca.world.resolve import world_at
from cnca.world.sight import Sight

LEAST_SHARE = 0.7
"""A view in which the world hides more of the vehicle is drawn again."""
REDRAWS = 8
"""Times that a block's views are drawn again before hidden ones are given up."""


def draw_blocks(
    scene: Scene, count: int, blocks: int, *, seed: int
) -> tuple[list[Sequence[View]], list[Weather]]:
    """``count`` views in ``blocks`` of neighbors, and a weather for each.

    The views of a block are taken at one place of the scene's world, where it has one.

    Raises:
        SceneError: the world hides the vehicle wherever one looks from.
    """
    weathers = draw_weathers(scene, blocks, seed=seed)
    if scene.world is None:
        return in_blocks(draw_views(scene, count, seed=seed), blocks), weathers
    spots = draw_spots(scene, seed=seed)
    views: list[Sequence[View]] = []
    sight, last = None, None
    for k, numbers in enumerate(in_blocks(range(count), blocks)):
        spot = spots[k * len(spots) // blocks]
        if sight is None or spot != last:
            sight, last = Sight(world_at(scene.world, scene.base, spot)), spot
        views.append(_seen(scene, sight, spot, len(numbers), seed=seed, start=(k + 1) * count))
    return views, weathers


def _seen(
    scene: Scene, sight: Sight, spot: Spot, count: int, *, seed: int, start: int
) -> list[View]:
    """The first views of the sequence from ``start`` on that show the vehicle.

    Where too few do, they are taken in turn.
    """
    seen: list[View] = []
    for _ in range(REDRAWS):
        drawn = draw_views(scene, count, seed=seed, start=start, spot=spot)
        seen += [view for view in drawn if sight.share(view) >= LEAST_SHARE]
        if len(seen) >= count:
            return seen[:count]
        start += count
    if not seen:
        raise SceneError(
            f"world: from variation's ranges nobody sees the vehicle at place {spot.place}; draw "
            "nearer views, or other places"
        )
    return [seen[k % len(seen)] for k in range(count)]
