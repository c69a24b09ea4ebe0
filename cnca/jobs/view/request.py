"""What ``cnca view`` is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cnca.core.errors import RunError
from cnca.core.options import COST, OUTPUT, STRENGTH, Flag


@dataclass(frozen=True)
class ViewRequest:
    """A scene file, what it shows at first, and where the page is."""

    scene: Annotated[Path, Flag("Scene file, such as builtin:street_day.", positional=True)]
    texture: Annotated[
        str, Flag("Picture, or folder of a run, for the paint; by default the scene's own.")
    ] = ""
    prompt: Annotated[str, Flag("Words that the shipped generator paints the vehicle by.")] = ""
    detector: Annotated[
        str, Flag("Whose boxes are drawn, such as builtin or a .cfg file; none by default.")
    ] = ""
    target_error: Annotated[
        float | None, Flag("Error to stay under; it can be moved in the page.", STRENGTH)
    ] = None
    width: Annotated[
        int | None, Flag("Pixels per row instead of the scene's; the height follows.", COST)
    ] = None
    out: Annotated[Path, Flag("Folder for what the page saves.", OUTPUT)] = Path("out/view")
    port: Annotated[int, Flag("Of the page; 0 takes any that is free.", OUTPUT)] = 8100

    def __post_init__(self) -> None:
        """Raises RunError for two paints, or a width that is no picture's."""
        if self.texture and self.prompt:
            raise RunError("--texture and --prompt: one paint at a time; leave one out")
        if self.width is not None and not 16 <= self.width <= 4096:
            raise RunError(f"--width {self.width}: give 16 to 4096 pixels")
