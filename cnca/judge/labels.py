"""Labelled photographs: COCO's JSON and Pascal VOC's XML."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import torch

from cnca.core.errors import RunError
from cnca.core.text import read_text
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


def read_labels(folder: Path, labels: Path) -> list[Photo]:
    """Read the labels of the photographs in ``folder``.

    ``labels`` is a COCO ``.json``, a VOC ``.xml`` or a folder of these (searched through; each
    picture lies beside the same folder below ``folder``, or where the file's own ``folder`` and
    ``filename`` say).  VOC counts pixels from 1 and includes the last: its boxes are widened to
    the pixels' borders.

    Raises:
        RunError: a file is missing or malformed, or nothing in it is a vehicle.
    """
    if not folder.is_dir():
        raise RunError(f"--photos {folder}: no such folder")
    if labels.is_dir():
        files = sorted(labels.rglob("*.xml"))
        if not files:
            raise RunError(f"--labels {labels}: no .xml in this folder")
        photos = [_read_voc(folder, file, file.parent.relative_to(labels)) for file in files]
    elif not labels.is_file():
        raise RunError(f"--labels {labels}: no such file")
    elif labels.suffix.lower() == ".json":
        photos = _read_coco(folder, labels)
    elif labels.suffix.lower() == ".xml":
        photos = [_read_voc(folder, labels, Path())]
    else:
        raise RunError(
            f"--labels {labels}: give COCO .json, or Pascal VOC .xml or a folder of them"
        )
    if not any(photo.objects for photo in photos):
        raise RunError(f"--labels {labels}: no object is labelled {', '.join(VEHICLES)}")
    return photos


def _read_coco(folder: Path, file: Path) -> list[Photo]:
    try:
        content = json.loads(read_text(file, RunError))
        names = {each["id"]: str(each["name"]) for each in content["categories"]}
        photos = {}
        for image in content["images"]:
            size = (image["width"], image["height"]) if "width" in image else None
            photos[image["id"]] = _photo(folder, Path(image["file_name"]), file, size)
        for each in content["annotations"]:
            left, top, width, height = (float(value) for value in each["bbox"])
            box = [left, top, left + width, top + height]
            crowd = bool(each.get("iscrowd", 0))
            photos[each["image_id"]].add(names[each["category_id"]], box, ignore=crowd)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise _malformed(file, error, "COCO's images, annotations and categories") from None
    return list(photos.values())


def _read_voc(folder: Path, file: Path, below: Path) -> Photo:
    try:
        root = _without_namespaces(ElementTree.parse(file).getroot())
        name = Path(_text(root, "filename"))
        inner = Path(root.findtext("folder") or "")
        places = [below / name, inner / name, name]
        place = next((p for p in places if (folder / p).is_file()), below / name)
        size = None
        if root.find("size") is not None:
            size = int(_text(root, "size/width")), int(_text(root, "size/height"))
        photo = _photo(folder, place, file, size)
        for each in root.iterfind("object"):
            corners = [float(_text(each, f"bndbox/{k}")) for k in ("xmin", "ymin", "xmax", "ymax")]
            box = [corners[0] - 1, corners[1] - 1, corners[2], corners[3]]
            difficult = (each.findtext("difficult") or "0").strip() == "1"
            photo.add(_text(each, "name"), box, ignore=difficult)
    except (OSError, ValueError, ElementTree.ParseError) as error:
        raise _malformed(file, error, "Pascal VOC's annotation") from None
    return photo


def _without_namespaces(root: ElementTree.Element) -> ElementTree.Element:
    """The same with plain names of elements: ``{http://…}object`` is object."""
    for element in root.iter():
        if isinstance(element.tag, str):
            element.tag = element.tag.rpartition("}")[2]
    return root


def _photo(folder: Path, place: Path, file: Path, size: tuple[int, int] | None) -> Photo:
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


def _text(element: ElementTree.Element, path: str) -> str:
    text = element.findtext(path)
    if text is None:
        raise ValueError(f"no {path}")
    return text.strip()


def _malformed(file: Path, error: Any, expected: str) -> RunError:
    reason = " ".join(str(error).split())
    return RunError(f"{file}: cannot be read ({reason}); expected {expected}")
