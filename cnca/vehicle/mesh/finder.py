"""The files that a mesh names, wherever they lie."""

from __future__ import annotations

from pathlib import Path, PurePosixPath, PureWindowsPath

import trimesh

NEARBY = 1
"""How many folders up a file is looked for that is not where the mesh says."""


class Finder(trimesh.resolvers.Resolver):
    """Finds the files that a mesh names: where it says, else nearby by their name."""

    def __init__(self, path: Path) -> None:
        self.folder = path.parent
        self.files: list[Path] = [path]
        """All that were read, the mesh itself first."""
        self.moved: dict[str, Path] = {}
        """Name in the mesh → where the file lay instead."""
        self.missing: list[str] = []
        """Names of files that were not found."""
        self._nearby: dict[str, Path] | None = None

    def get(self, name: str) -> bytes:
        """The file's bytes; trimesh takes an error as the sign of a missing picture."""
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
                # Not the whole disk: only while the folders look like those of one project.
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

    def namespaced(self, namespace: str) -> Finder:
        """Names keep their meaning: folders are part of them."""
        return self

    def keys(self) -> list[str]:
        """Unknown before they are asked for."""
        return []
