"""A world's file as it stands there, its pictures found wherever they lie."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import trimesh

from cnca.vehicle.mesh.finder import Finder
from cnca.vehicle.mesh.mesh_file import read_meshes


@dataclass
class Reading:
    """What was read, and what was looked for."""

    scene: trimesh.Scene
    files: list[Path] = field(default_factory=list)
    """All that were read, the file itself first."""
    moved: dict[str, Path] = field(default_factory=dict)
    """Name in the file → where it lay instead."""
    missing: list[str] = field(default_factory=list)
    """Names of files that lay nowhere."""


def read_world(path: Path) -> Reading:
    """The file's surfaces as they stand in it; raises MeshError where there are none."""
    finder = Finder(path)
    return Reading(read_meshes(path, finder), finder.files, finder.moved, finder.missing)
