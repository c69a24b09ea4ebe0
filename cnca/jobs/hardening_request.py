"""What ``cnca harden`` is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cnca.core.errors import DetectorError, did_you_mean
from cnca.core.options import COST, OUTPUT, STRENGTH, Flag


@dataclass(frozen=True)
class HardeningRequest:
    """A built-in detector that is to learn camouflages."""

    textures: Annotated[
        tuple[str, ...],
        Flag("Camouflage, as for evaluate; repeatable: [NAME=]PATH.", name="texture"),
    ]
    out: Annotated[Path, Flag("Folder for pictures, weights and table.", OUTPUT)]
    detector: Annotated[str, Flag("A built-in one.")] = "builtin"
    scene: Annotated[
        Path | None, Flag("Scene file; by default that of the first texture's run.")
    ] = None
    pictures: Annotated[int, Flag("Pictures to render.", STRENGTH)] = 480
    epochs: Annotated[int, Flag("Passes over the pictures.", STRENGTH)] = 24
    views: Annotated[int, Flag("Held-out views that judge it.", COST)] = 96
    """They judge the detector before and after."""
    seed: Annotated[int, Flag("Seed of everything random.")] = 0

    def __post_init__(self) -> None:
        """Raises DetectorError for a detector that is none of the built-in ones."""
        from cnca.detect import BUILTINS  # loads torch

        if self.detector not in BUILTINS:
            hint = did_you_mean(self.detector, BUILTINS)
            raise DetectorError(
                f"--detector {self.detector}: only built-in ones are hardened, "
                f"{', '.join(BUILTINS)}{hint}"
            )

    @property
    def hardened(self) -> str:
        """What names the hardened detector to ``--detector``."""
        from cnca.detect import BUILTINS

        template, folder = BUILTINS[self.detector], self.out / "detector"
        return str(folder / template.name if template.suffix else folder)
