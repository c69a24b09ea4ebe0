"""What ``cnca transfer`` is asked for besides its attacks."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cnca.core.errors import RunError
from cnca.core.options import COST, Flag


@dataclass(frozen=True)
class Judging:
    """Who judges the camouflages, and where."""

    judges: Annotated[
        tuple[str, ...],
        Flag("Further detector that judges and is not attacked; repeatable.", name="judge"),
    ] = ()
    scenes: Annotated[
        tuple[Path, ...],
        Flag("Further scene to judge in, such as one in fog; repeatable.", name="judge_scene"),
    ] = ()
    textures: Annotated[
        tuple[str, ...], Flag("Further [NAME=]PATH to judge, such as a rival's.", name="texture")
    ] = ()
    views: Annotated[int, Flag("Views of each scene that judge.", COST)] = 48
    seeds: Annotated[int, Flag("Attacks on each detector, from --seed on.", COST)] = 1

    def __post_init__(self) -> None:
        """Raises RunError for a number of seeds below 1."""
        if self.seeds < 1:
            raise RunError(f"--seeds {self.seeds}: attack each detector at least once")
