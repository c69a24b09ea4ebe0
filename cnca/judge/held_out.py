"""The views and weathers that judge an attack: never those that trained it."""

from __future__ import annotations

from cnca.judge.evaluate import Shots
from cnca.scene.schema import Scene
from cnca.world.draw import draw_blocks

HELD_OUT_SEED = 104_729
"""Added to a run's seed."""


def held_out_shots(scene: Scene, count: int, seed: int) -> Shots:
    """Views and weathers of the scene's ranges that the attack with this seed does not see."""
    blocks = max(1, min(8, count // 4))
    return Shots(*draw_blocks(scene, count, blocks, seed=seed + HELD_OUT_SEED), seed)
