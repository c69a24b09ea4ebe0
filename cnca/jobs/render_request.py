"""What ``cnca render-scene`` is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cnca.core.errors import RunError
from cnca.core.options import COST, OUTPUT, STRENGTH, Flag

FORMATS = (".png", ".exr")


@dataclass(frozen=True)
class RenderRequest:
    """Views of a scene file, and how they are to be rendered."""

    scene: Annotated[Path, Flag("Scene file, such as scenes/sedan_fog.yaml.", positional=True)]
    out: Annotated[Path, Flag("Picture to write: .png or .exr.", OUTPUT, short="o")]
    """With ``all_views`` each view's name is put before the ending."""
    view: Annotated[str | None, Flag("Camera by name; by default the first.")] = None
    all_views: Annotated[bool, Flag("Every camera.")] = False
    texture: Annotated[Path | None, Flag("sRGB picture for the paint.")] = None
    """By default the scene's own paint."""
    target_error: Annotated[
        float | None,
        Flag("Take the cheapest models and samples under this error.", STRENGTH),
    ] = None
    reference: Annotated[bool, Flag("Full simulation.", STRENGTH)] = False
    effects: Annotated[
        tuple[str, ...],
        Flag(
            "Model for one effect, such as fog=none or sun=disc; repeatable.",
            STRENGTH,
            name="effect",
        ),
    ] = ()
    samples: Annotated[
        int | None, Flag("Rays per pixel instead of the scene's.", COST, name="spp")
    ] = None
    """By default the scene's, or what a target error takes."""
    seed: Annotated[int, Flag("Seed of the noise.")] = 0

    def __post_init__(self) -> None:
        """Raises RunError for a format that is not written, or no rays."""
        if self.out.suffix.lower() not in FORMATS:
            formats = " or ".join(FORMATS)
            raise RunError(f"{self.out}: pictures are written as {formats}; change the ending")
        if self.samples is not None and self.samples < 1:
            raise RunError(f"--spp {self.samples}: a picture needs at least one ray per pixel")
