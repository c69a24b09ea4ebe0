"""A labelled photograph."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath, PureWindowsPath

import torch

from cnca.core.errors import RunError
from cnca.core.types import Boxes
from cnca.detect.classes import VEHICLES, known_name

UNGROUPED = "photos"


@dataclass
class Photo:
    """A photograph and the vehicles in it."""

    path: Path
    group: str
    """The folder right below that of all photographs, or :data:`UNGROUPED`."""
    size: tuple[int, int] | None = None
    """Width and height in pixels as the labels have it, if they do."""
    objects: dict[str, list[list[float]]] = field(default_factory=dict)
    """One of ``cnca.detect.classes.VEHICLES`` → boxes, xyxy in pixels from the picture's corner."""
    ignored: list[list[float]] = field(default_factory=list)
    """Boxes of crowds and of vehicles marked as difficult: neither hit nor miss nor false alarm."""

    def boxes(self, classes: tuple[str, ...]) -> Boxes:
        """All objects of these classes, (objects, 4)."""
        found = [box for name in classes for box in self.objects.get(name, [])]
        return torch.tensor(found, dtype=torch.float32).reshape(-1, 4)

    def add(self, name: str, box: list[float], *, ignore: bool) -> None:
        """Take a labelled object; other things than vehicles are left out."""
        name = known_name(name)
        if name in VEHICLES and ignore:
            self.ignored.append(box)
        elif name in VEHICLES:
            self.objects.setdefault(name, []).append(box)


def photo_at(folder: Path, place: Path, file: Path, size: tuple[int, int] | None) -> Photo:
    """The photograph at ``place`` below ``folder``; raises RunError where ``file`` names none."""
    path = _find(folder, place)
    if path is None:
        raise RunError(f"{file}: names {place}, which is not in {folder}")
    return Photo(path, place.parts[0] if len(place.parts) > 1 else UNGROUPED, size)


def _find(folder: Path, place: Path) -> Path | None:
    """The picture that labels name, also by a path of another machine or in another case."""
    named = PurePosixPath(PureWindowsPath(place).as_posix())
    for path in (folder / place, folder / named, folder / named.name):
        if path.is_file():
            return path
    below = folder / named.parent if (folder / named.parent).is_dir() else folder
    alike = [path for path in below.iterdir() if path.name.lower() == named.name.lower()]
    return alike[0] if len(alike) == 1 else None
