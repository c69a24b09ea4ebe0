"""Labelled photographs: COCO's JSON, Pascal VOC's XML and YOLO's text files."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

from cnca.core.errors import RunError
from cnca.core.text import read_text
from cnca.detect.classes import VEHICLES
from cnca.judge.photo import Photo, photo_at
from cnca.judge.yolo_labels import class_names, read_yolo


def read_labels(folder: Path, labels: Path, names: str | None = None) -> list[Photo]:
    """Read the labels of the photographs in ``folder``.

    ``labels`` is a COCO ``.json``, a VOC ``.xml``, or a folder of these or of YOLO's ``.txt``,
    whose classes are called as ``names`` says (:mod:`cnca.judge.yolo_labels`).  It is searched
    through; each picture lies beside the same folder below ``folder``, or where a VOC file's own
    ``folder`` and ``filename`` say.  VOC counts pixels from 1 and includes the last: its boxes are
    widened to the pixels' borders.

    Raises:
        RunError: a file is missing or malformed, or nothing in it is a vehicle.
    """
    if not folder.is_dir():
        raise RunError(f"--photos {folder}: no such folder")
    if labels.is_dir():
        files = sorted(labels.rglob("*.xml"))
        photos = [_read_voc(folder, file, file.parent.relative_to(labels)) for file in files]
        photos = photos or read_yolo(folder, labels, class_names(names, labels))
        if not photos:
            raise RunError(f"--labels {labels}: no .xml and no .txt in this folder")
    elif not labels.is_file():
        raise RunError(f"--labels {labels}: no such file")
    elif labels.suffix.lower() == ".json":
        photos = _read_coco(folder, labels)
    elif labels.suffix.lower() == ".xml":
        photos = [_read_voc(folder, labels, Path())]
    else:
        raise RunError(
            f"--labels {labels}: give COCO .json, Pascal VOC .xml or a folder of these, or a "
            "folder of YOLO's .txt"
        )
    if not any(photo.objects for photo in photos):
        raise RunError(f"--labels {labels}: no object is labelled {', '.join(VEHICLES)}")
    return photos


def _read_coco(folder: Path, file: Path) -> list[Photo]:
    try:
        content = json.loads(read_text(file, RunError))
        names = {kind["id"]: str(kind["name"]) for kind in content["categories"]}
        photos = {}
        for image in content["images"]:
            size = (image["width"], image["height"]) if "width" in image else None
            photos[image["id"]] = photo_at(folder, Path(image["file_name"]), file, size)
        for annotation in content["annotations"]:
            left, top, width, height = (float(value) for value in annotation["bbox"])
            box = [left, top, left + width, top + height]
            crowd = bool(annotation.get("iscrowd", 0))
            photos[annotation["image_id"]].add(names[annotation["category_id"]], box, ignore=crowd)
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
        photo = photo_at(folder, place, file, size)
        for thing in root.iterfind("object"):
            corners = [float(_text(thing, f"bndbox/{k}")) for k in ("xmin", "ymin", "xmax", "ymax")]
            box = [corners[0] - 1, corners[1] - 1, corners[2], corners[3]]
            difficult = (thing.findtext("difficult") or "0").strip() == "1"
            photo.add(_text(thing, "name"), box, ignore=difficult)
    except (OSError, ValueError, ElementTree.ParseError) as error:
        raise _malformed(file, error, "Pascal VOC's annotation") from None
    return photo


def _without_namespaces(root: ElementTree.Element) -> ElementTree.Element:
    """The same with plain names of elements: ``{http://…}object`` is object."""
    for element in root.iter():
        if isinstance(element.tag, str):
            element.tag = element.tag.rpartition("}")[2]
    return root


def _text(element: ElementTree.Element, path: str) -> str:
    text = element.findtext(path)
    if text is None:
        raise ValueError(f"no {path}")
    return text.strip()


def _malformed(file: Path, error: Any, expected: str) -> RunError:
    reason = " ".join(str(error).split())
    return RunError(f"{file}: cannot be read ({reason}); expected {expected}")
