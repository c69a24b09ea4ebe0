"""What ``cnca reorder-uv`` reads."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cnca.core.options import Flag


@dataclass(frozen=True)
class Source:
    """A mesh as its file has it, with the textures in its UV space; or a scene file with one."""

    mesh: Annotated[
        str, Flag("Mesh, builtin:NAME, or a scene file, which says the rest.", positional=True)
    ]
    up: Annotated[str, Flag("The file's upward axis.")] = "y"
    front: Annotated[str, Flag("The file's forward axis.")] = "+x"
    scale: Annotated[float, Flag("Metres per unit of the file.")] = 1.0
    paint_mask: Annotated[Path | None, Flag("White where there is paint.")] = None
    base_texture: Annotated[Path | None, Flag("The car's own texture.")] = None
    materials: Annotated[
        str | None, Flag("What its materials are, such as '{Body: paint}'.", metavar="MAPPING")
    ] = None
