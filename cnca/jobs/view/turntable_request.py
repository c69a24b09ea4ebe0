"""What ``cnca turntable`` is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cnca.core.errors import RunError
from cnca.core.options import COST, OUTPUT, Flag

FORMATS = (".webp", ".gif")
MOST_FRAMES = 360


@dataclass(frozen=True)
class TurntableRequest:
    """A run whose camouflage turns beside the plain paint."""

    run: Annotated[Path, Flag("Folder of a cnca optimize that has ended.", positional=True)]
    scene: Annotated[Path | None, Flag("Another scene than the run's.")] = None
    detector: Annotated[str | None, Flag("Whose boxes are drawn; by default the run's first.")] = (
        None
    )
    frames: Annotated[int, Flag("Views around the vehicle.", COST)] = 24
    width: Annotated[int, Flag("Pixels per row of each of both pictures.", COST)] = 320
    samples: Annotated[int, Flag("Rays per pixel.", COST, name="spp")] = 12
    out: Annotated[
        Path | None,
        Flag("Animation to write: .webp or .gif; by default turntable.webp in the run.", OUTPUT),
    ] = None

    def __post_init__(self) -> None:
        """Raises RunError for a format that is not written, or numbers that are no picture's."""
        if self.target.suffix.lower() not in FORMATS:
            formats = " or ".join(FORMATS)
            raise RunError(f"{self.target}: animations are written as {formats}; change the ending")
        if not 2 <= self.frames <= MOST_FRAMES:
            raise RunError(f"--frames {self.frames}: give 2 to {MOST_FRAMES}")
        if not 16 <= self.width <= 2048:
            raise RunError(f"--width {self.width}: give 16 to 2048 pixels")
        if self.samples < 1:
            raise RunError(f"--spp {self.samples}: a picture needs at least one ray per pixel")

    @property
    def target(self) -> Path:
        """The file that is written."""
        return self.out or self.run / "turntable.webp"
