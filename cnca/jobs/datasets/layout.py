"""The layout of a data set of pictures with one vehicle each::

    images/000000.png       sRGB, 8 bits
    masks/000000.png        share of each pixel that the vehicle covers, 255 the whole
    records/000000.json     pose, weather, paint, box, what else is there: written last, so it says
                            "done"
    annotations.json        all records in COCO's format, with boxes and masks of every vehicle
    shards/000000.tar       WebDataset: 000000.png, 000000.mask.png, 000000.json, 000001.png, …
    outlines/000000.png     of CARLA frames: the mesh's outline over the photograph
    contact_sheet.png       a few pictures with their boxes

``torchvision.datasets.CocoDetection(f"{out}/images", f"{out}/annotations.json")`` and
``webdataset.WebDataset(f"{out}/shards/{{000000..000003}}.tar")`` read it.
"""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import torch
from jaxtyping import Float

from cnca.core.errors import RunError
from cnca.core.files import replacing
from cnca.core.manifest import write_json
from cnca.core.pictures import SrgbPicture, draw_boxes, side_by_side, write_png
from cnca.core.records import as_json
from cnca.detect.classes import CAR, COCO91, GENERIC, VEHICLE, known_name
from cnca.scene.layers import Sighting

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

COVERED = 0.5
"""Share of a pixel from which it belongs to COCO's segmentation."""
PER_TAR = 1000
SHEET = 16
"""Pictures on the contact sheet."""

Mask = Float[np.ndarray, "height width"]


class DataSet:
    """A folder in this layout."""

    def __init__(self, folder: Path, label: str = CAR) -> None:
        """``label`` is what the pictured vehicle is."""
        self.folder, self.label = folder, label

    def path(self, kind: str, index: int) -> Path:
        """The file of one picture; ``kind`` is the folder."""
        return self.folder / kind / f"{index:06d}{'.json' if kind == 'records' else '.png'}"

    def has(self, index: int) -> bool:
        """Whether a picture is done."""
        return self.path("records", index).exists()

    def add(
        self,
        index: int,
        picture: SrgbPicture,
        mask: Mask,
        record: DataclassInstance,
        *,
        occluded: float = 0.0,
        others: Sequence[Sighting] = (),
    ) -> None:
        """Write one picture, its mask (shares in [0, 1]) and its record.

        Args:
            occluded: share of the vehicle that something hides.
            others: what else with a label is in the picture.
        """
        write_png(self.path("images", index), picture)
        grey = (mask * 255).round().astype(np.uint8)
        write_png(self.path("masks", index), np.repeat(grey[..., None], 3, axis=2))
        content = {"index": index} | as_json(extent_of(mask)) | as_json(record)
        content |= {"occluded": round(occluded, 4), "others": [as_other(o) for o in others]}
        write_json(self.path("records", index), content)

    def indices(self) -> list[int]:
        """Numbers of all pictures that are done."""
        return sorted(int(path.stem) for path in (self.folder / "records").glob("*.json"))

    def record(self, index: int) -> dict[str, Any]:
        """The record of a picture that is done; raises RunError where it is damaged."""
        path = self.path("records", index)
        try:
            return json.loads(path.read_text(encoding="utf-8"))
        except ValueError:
            raise RunError(f"{path}: damaged; delete it to make the picture again") from None

    def finish(self, *, tar: bool) -> None:
        """Write ``annotations.json``, the contact sheet and, if wanted, the tars."""
        indices = self.indices()
        records = [self.record(index) for index in indices]
        masks = (self._mask(index) for index in indices)
        write_json(self.folder / "annotations.json", coco(records, masks, self.label))
        if indices:
            self._write_sheet(records)
        if tar:
            groups: dict[int, list[int]] = {}
            for index in indices:
                groups.setdefault(index // PER_TAR, []).append(index)
            for number, members in groups.items():
                self._write_tar(self.folder / "shards" / f"{number:06d}.tar", members)

    def _mask(self, index: int) -> Mask:
        return cv2.imread(str(self.path("masks", index)), cv2.IMREAD_GRAYSCALE) / 255

    def _write_sheet(self, records: list[dict[str, Any]]) -> None:
        chosen = records[:: max(1, len(records) // SHEET)][:SHEET]
        tiles = []
        for record in chosen:
            picture = cv2.imread(str(self.path("images", record["index"])))[..., ::-1]
            box = torch.tensor(record["box_xyxy"])
            tiles.append(draw_boxes(np.ascontiguousarray(picture), None, [], box))
        captions = [str(record.get("caption", record["index"])) for record in chosen]
        write_png(self.folder / "contact_sheet.png", side_by_side(tiles, captions, columns=4))

    def _write_tar(self, path: Path, indices: list[int]) -> None:
        """Members without times or owners: the same pictures give the same bytes."""
        endings = {"images": ".png", "masks": ".mask.png", "records": ".json"}
        with replacing(path) as temporary, tarfile.open(temporary, "w") as tar:
            for index in indices:
                for kind, ending in endings.items():
                    content = self.path(kind, index).read_bytes()
                    member = tarfile.TarInfo(f"{index:06d}{ending}")
                    member.size = len(content)
                    tar.addfile(member, io.BytesIO(content))


@dataclass(frozen=True)
class Extent:
    """Pixels of a picture and of the vehicle in it."""

    height: int
    width: int
    box_xyxy: tuple[int, int, int, int]


def extent_of(mask: Mask) -> Extent:
    """Size of the picture and box of all pixels that the vehicle touches, xyxy."""
    left, top, width, height = cv2.boundingRect((mask > 0).astype(np.uint8))
    box = left, top, left + width, top + height
    if width == 0:
        raise RunError("a picture without the vehicle has no place in the data set")
    height, width = mask.shape
    return Extent(height, width, box)


def category(label: str) -> dict[str, Any]:
    """A class as COCO numbers it, so that detectors trained there need no other table.

    One that COCO does not have gets the first number after COCO's.
    """
    name = known_name(label)
    number = COCO91.index(name) if name in COCO91 else len(COCO91)
    return {"id": number, "name": name, "supercategory": VEHICLE if name in GENERIC else name}


def coco(records: list[dict[str, Any]], masks: Iterable[Mask], label: str = CAR) -> dict[str, Any]:
    """COCO's object detection format; everything else of a record stands in ``images``.

    The vehicle comes first, numbered as its picture; ``occluded`` is the share that something
    hides.  Then the other objects of a world, of their own categories.
    """
    images, annotations = [], []
    kinds = {known_name(label): category(label)}
    for record, mask in zip(records, masks, strict=True):
        index = record["index"]
        left, top, right, bottom = record["box_xyxy"]
        content = {key: value for key, value in record.items() if key != "others"}
        images.append({"id": index, "file_name": f"{index:06d}.png"} | content)
        annotations.append(
            {
                "id": index + 1,  # COCO's tools take 0 for "none"
                "image_id": index,
                "category_id": category(label)["id"],
                "bbox": [left, top, right - left, bottom - top],
                "area": int((mask >= COVERED).sum()),
                "segmentation": run_lengths(mask),
                "iscrowd": 0,
                "occluded": record.get("occluded", 0.0),
            }
        )
    number = max((annotation["id"] for annotation in annotations), default=0)
    for record in records:
        for other in record.get("others", ()):
            kind, number = category(other["label"]), number + 1
            kinds[kind["name"]] = kind
            described = {key: value for key, value in other.items() if key != "label"}
            place = {"id": number, "image_id": record["index"], "category_id": kind["id"]}
            annotations.append(place | described | {"iscrowd": 0})
    return {"images": images, "annotations": annotations, "categories": list(kinds.values())}


def as_other(seen: Sighting) -> dict[str, Any]:
    """Another object of a picture, as records and COCO's annotations have it."""
    left, top, right, bottom = seen.box
    return {
        "label": known_name(seen.label),
        "bbox": [left, top, right - left, bottom - top],
        "area": int(seen.mask.sum()),
        "segmentation": run_lengths(seen.mask.astype(float)),
        "occluded": round(seen.occluded, 4),
    }


def run_lengths(mask: Mask) -> dict[str, list[int]]:
    """COCO's uncompressed run lengths: columns one after the other, first how many are empty."""
    covered = (mask >= COVERED).T.ravel()
    changes = np.flatnonzero(np.diff(covered.astype(np.int8))) + 1
    starts = [0] if not covered[0] else [0, 0]
    counts = np.diff([*starts, *changes, covered.size])
    return {"size": list(mask.shape), "counts": counts.tolist()}
