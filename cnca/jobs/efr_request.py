"""What ``cnca train-efr`` is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cnca.core.errors import RunError
from cnca.core.options import COST, OUTPUT, STRENGTH, Flag
from cnca.mi_bridge.backends import parse_backend


@dataclass(frozen=True)
class EfrRequest:
    """The pairs from which an EFR learns, and for how long."""

    out: Annotated[Path, Flag("Weights to write, .safetensors; report beside.", OUTPUT)]
    """Checkpoints go into a folder of the same name without the ending."""
    scenes: Annotated[
        tuple[Path, ...],
        Flag("Scene file to draw pairs from; repeatable.", name="from_render"),
    ] = ()
    carla: Annotated[Path | None, Flag("Folder of CARLA frames instead.")] = None
    carla_scene: Annotated[Path, Flag("Scene file with their vehicle.")] = Path(
        "scenes/etron_carla.yaml"
    )
    backend: Annotated[str, Flag("Renderer to correct.")] = "raster"
    samples: Annotated[int, Flag("Its rays per pixel.", COST, name="spp")] = 4
    views: Annotated[int, Flag("Views to train on, each in six paints.", STRENGTH)] = 64
    """A quarter as many are for the test."""
    epochs: Annotated[int, Flag("Passes over them.", STRENGTH)] = 20
    seed: Annotated[int, Flag("Seed of everything random.")] = 0

    def __post_init__(self) -> None:
        """Raises CncaError for an unknown backend, both or no sources, or a number out of range."""
        parse_backend(self.backend)
        if bool(self.scenes) == (self.carla is not None):
            raise RunError("give either --from-render SCENE, once or more, or --carla DIR")
        if self.out.suffix != ".safetensors":
            raise RunError(f"{self.out}: weights are written as .safetensors; change the ending")
        if self.views < 1:
            raise RunError(f"--views {self.views}: give a number above 0")
