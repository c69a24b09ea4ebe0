"""What ``cnca render-dataset`` is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cnca.core.options import COST, OUTPUT, Flag


@dataclass(frozen=True)
class DatasetRequest:
    """The grid of a scene, or its beginning, as labelled pictures."""

    scene: Annotated[Path, Flag("Scene file.")]
    out: Annotated[Path, Flag("Folder; the same command goes on in it.", OUTPUT)]
    images: Annotated[int | None, Flag("Pictures; by default the whole grid.", COST)] = None
    shard: Annotated[str, Flag("Which part to render, such as 2/4.", COST)] = "1/1"
    tar: Annotated[bool, Flag("Pack WebDataset tars, too.", OUTPUT)] = False
    samples: Annotated[
        int | None, Flag("Rays per pixel instead of the scene's.", COST, name="spp")
    ] = None
