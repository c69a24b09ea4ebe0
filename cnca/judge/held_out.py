"""The views and weathers that judge an attack: never those that trained it."""

from __future__ import annotations

from cnca.judge.evaluate import Shots
from cnca.scene.schema import Scene
from cnca.scene.variation import draw_views, draw_weathers, in_blocks

HELD_OUT_SEED = 104_729
"""Added to a run's seed."""


def held_out_shots(scene: Scene, count: int, seed: int) -> Shots:
    """Views and weathers of the scene's ranges that the attack with this seed does not see."""
    weathers = draw_weathers(scene, max(1, min(8, count // 4)), seed=seed + HELD_OUT_SEED)
    views = draw_views(scene, count, seed=seed + HELD_OUT_SEED)
    return Shots(in_blocks(views, len(weathers)), weathers, seed)
