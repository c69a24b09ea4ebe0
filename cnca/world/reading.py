"""A world's file as trimesh reads it, its pictures found wherever they lie."""

from __future__ import annotations

import io
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath, PureWindowsPath

import trimesh

from cnca.core.errors import MeshError, did_you_mean
from cnca.vehicle.mesh.mesh_file import EXTENSIONS

NEARBY = 1
"""Folders above the file's own in which a picture may lie that is not where the file says."""


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


class _Finder(trimesh.resolvers.Resolver):
    """Finds the files that a mesh names: where it says, else by their name nearby."""

    def __init__(self, path: Path) -> None:
        self.folder = path.parent
        self.files, self.moved, self.missing = [path], {}, []  # type: ignore[var-annotated]
        self._nearby: dict[str, Path] | None = None

    def get(self, name: str) -> bytes:
        """Its bytes; trimesh takes an error for a picture that is not there."""
        name = name.strip().strip('"')
        file = self.folder / name
        if not file.is_file():
            other = self._find(PurePosixPath(PureWindowsPath(name).as_posix()).name)
            if other is None:
                self.missing.append(name)
                raise FileNotFoundError(name)
            file = self.moved[name] = other
        if file not in self.files:
            self.files.append(file)
        return file.read_bytes()

    def _find(self, name: str) -> Path | None:
        if self._nearby is None:
            top = self.folder
            for _ in range(NEARBY):
                # Not the whole disk: only while the folders look like those of one world.
                if len(list(top.parent.iterdir())) > 64:
                    break
                top = top.parent
            self._nearby = {}
            for file in sorted(top.rglob("*"), key=lambda f: len(f.parts), reverse=True):
                self._nearby[file.name.lower()] = file
        return self._nearby.get(name.lower())

    def write(self, name: str, data: bytes) -> None:
        """Nothing is ever written."""
        raise NotImplementedError

    def namespaced(self, namespace: str) -> _Finder:
        """Names keep their meaning: folders are part of them."""
        return self

    def keys(self) -> list[str]:
        """Unknown before they are asked for."""
        return []


def read_world(path: Path) -> Reading:
    """The file's surfaces as they stand in it; raises MeshError where there are none."""
    extension = path.suffix.lower()
    if extension not in EXTENSIONS:
        hint = did_you_mean(extension, EXTENSIONS)
        raise MeshError(f"{path}: not one of {', '.join(EXTENSIONS)}{hint}")
    if not path.is_file():
        raise MeshError(f"{path}: no such file; paths start at the scene file's folder")
    finder = _Finder(path)
    try:
        scene = trimesh.load_scene(
            io.BytesIO(path.read_bytes()),
            file_type=extension.removeprefix("."),
            resolver=finder,
            process=False,
        )
    except Exception as error:  # trimesh's readers raise whatever a broken file makes them raise
        reason = " ".join(str(error).split()) or type(error).__name__
        kind = extension.removeprefix(".").upper()
        raise MeshError(f"{path}: cannot be read as {kind} ({reason}); export it again") from error
    for key, mesh in list(scene.geometry.items()):
        if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
            scene.delete_geometry(key)
    if not len(scene.graph.nodes_geometry):
        raise MeshError(f"{path}: holds no triangles; export the mesh, not only points or curves")
    return Reading(scene, finder.files, finder.moved, finder.missing)
