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
        Flag("Take the cheapest models and rays whose measured error is under this.", STRENGTH),
    ] = None
    target_seconds: Annotated[
        float | None,
        Flag("Make the best picture in so many processor seconds.", COST),
    ] = None
    """The pilot's included, which chooses the models; reading the scene is not."""
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
        """Raises RunError for a format that is not written, no rays, or targets that conflict."""
        if self.out.suffix.lower() not in FORMATS:
            formats = " or ".join(FORMATS)
            raise RunError(f"{self.out}: pictures are written as {formats}; change the ending")
        if self.samples is not None and self.samples < 1:
            raise RunError(f"--spp {self.samples}: a picture needs at least one ray per pixel")
        if self.target_seconds is not None and not self.target_seconds > 0:
            raise RunError(f"--target-seconds {self.target_seconds:g}: give a number above 0")
        if self.target_seconds is not None and (self.target_error or self.samples):
            other = "--target-error" if self.target_error else "--spp"
            raise RunError(f"--target-seconds chooses the rays: leave {other} out")

    @property
    def measures(self) -> bool:
        """Whether the picture's error is measured while it is made."""
        by_error = self.target_error is not None and self.samples is None
        return (by_error or self.target_seconds is not None) and not self.reference
