"""What ``cnca accuracy`` and ``cnca accuracy-generator`` are asked for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cnca.core.errors import RunError
from cnca.core.options import COST, OUTPUT, STRENGTH, Flag
from cnca.gen import GUIDANCE
from cnca.gen.choices import CONCAT


@dataclass(frozen=True)
class AccuracyRequest:
    """One view on which the ladder of plans is measured."""

    scene: Annotated[Path, Flag("Scene file.", positional=True)]
    out: Annotated[Path, Flag("Folder for table, picture and reference.", OUTPUT)]
    seconds: Annotated[float, Flag("Budget of processor seconds.", COST)] = 900.0
    """The reference takes at most two fifths of it."""
    view: Annotated[str | None, Flag("Camera by name; by default the first.")] = None
    detector: Annotated[str, Flag("builtin, or a Darknet .cfg, or an .onnx.")] = "builtin"
    volpath: Annotated[
        bool, Flag("Fog's reference by Mitsuba's volumetric path tracer.", STRENGTH)
    ] = False

    def __post_init__(self) -> None:
        """Raises RunError where there is no time."""
        if not self.seconds > 0:
            raise RunError(f"--seconds {self.seconds:g}: give a number above 0")


@dataclass(frozen=True)
class GradientRequest:
    """The generator whose shortened gradients are compared with the full one."""

    out: Annotated[Path, Flag("Folder for table and picture.", OUTPUT)]
    prompt: Annotated[str, Flag("What to paint.")] = "colorful camouflage"
    generator: Annotated[
        Path | None, Flag("Folder in diffusers format; by default the shipped one.")
    ] = None
    feature: Annotated[str, Flag("concat or replace.", STRENGTH)] = CONCAT
    guidance: Annotated[float, Flag("Scale of classifier-free guidance.", STRENGTH)] = GUIDANCE
    probes: Annotated[int, Flag("Gradients to average over.", COST)] = 3
    seed: Annotated[int, Flag("Seed of everything random.")] = 0

    def __post_init__(self) -> None:
        """Raises RunError where nothing is averaged."""
        if self.probes < 1:
            raise RunError(f"--probes {self.probes}: give at least 1")
