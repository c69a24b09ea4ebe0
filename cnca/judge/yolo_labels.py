"""Labels of photographs as YOLO's ``.txt``: class, centre and size in parts of the picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from PIL import Image, UnidentifiedImageError

from cnca.core.errors import RunError
from cnca.core.text import read_text
from cnca.detect.classes import CAR, CLASS_LISTS, VEHICLE, read_names
from cnca.judge.photo import Photo, photo_at

SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".webp")
TURNED = range(5, 9)
"""Values of EXIF's orientation by which width and height change places."""
ORIENTATION = 0x0112
NAME_FILES = ("classes.txt", "obj.names")
"""Names of the classes beside the labels, as labelling programs leave them."""


def class_names(said: str | None, labels: Path) -> Sequence[str]:
    """The names of the classes: a list's name, a file, names with commas; else those beside.

    Without any of these they are COCO's 80.
    """
    if said is None:
        beside = [labels / name for name in NAME_FILES if (labels / name).is_file()]
        return read_names(beside[0]) if beside else CLASS_LISTS["coco"]
    if said in CLASS_LISTS:
        return CLASS_LISTS[said]
    return read_names(Path(said)) if Path(said).is_file() else [n.strip() for n in said.split(",")]


def read_yolo(folder: Path, labels: Path, names: Sequence[str]) -> list[Photo]:
    """Every ``.txt`` below ``labels`` with the picture of the same name below ``folder``.

    A class called ``vehicle`` or ``vehicles`` is taken as cars, since it is not told apart.

    Raises RunError where a picture is missing, or a line says no box.
    """
    files = [f for f in sorted(labels.rglob("*.txt")) if f.name not in NAME_FILES]
    return [_read(folder, file, file.relative_to(labels).with_suffix(""), names) for file in files]


def _read(folder: Path, file: Path, stem: Path, names: Sequence[str]) -> Photo:
    place = next(
        (p for s in SUFFIXES if (folder / (p := stem.with_name(stem.name + s))).is_file()), None
    )
    if place is None:
        raise RunError(f"{file}: no picture {stem}.jpg or .png in {folder}")
    width, height = size = _size(folder / place)
    photo = photo_at(folder, place, file, size)
    lines = read_text(file, RunError).splitlines()
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        label, x, y, w, h = _numbers(line, f"{file}, line {number}", names)
        box = [(x - w / 2) * width, (y - h / 2) * height]
        box += [(x + w / 2) * width, (y + h / 2) * height]
        name = names[int(label)].lower()
        photo.add(CAR if name in (VEHICLE, "vehicles") else name, box, ignore=False)
    return photo


def _numbers(line: str, where: str, names: Sequence[str]) -> list[float]:
    """Class and box; further columns, such as confidences, are left out."""
    try:
        values = [float(word) for word in line.split()][:5]
    except ValueError:
        values = []
    if len(values) < 5 or not all(map(math.isfinite, values)):
        raise RunError(f"{where}: '{line[:40]}' is not class, centre and size in parts of 1")
    if values[0] not in range(len(names)):
        raise RunError(
            f"{where}: class {values[0]:g} has no name, there are {len(names)}; say --label-names"
        )
    return values


def _size(path: Path) -> tuple[int, int]:
    """Width and height as the picture is shown."""
    try:
        with Image.open(path) as picture:
            turned = picture.getexif().get(ORIENTATION) in TURNED
            return picture.size[::-1] if turned else picture.size
    except (OSError, UnidentifiedImageError) as error:
        raise RunError(f"{path}: cannot be read as a picture ({error})") from None
