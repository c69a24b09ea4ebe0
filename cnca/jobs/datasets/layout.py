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
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
import torch

from cnca.core.errors import RunError
from cnca.core.files import replacing
from cnca.core.manifest import write_json
from cnca.core.pictures import SrgbPicture, draw_boxes, side_by_side, write_png
from cnca.core.records import as_json, from_json
from cnca.detect.classes import CAR
from cnca.jobs.datasets.coco import Box, Entry, Mask, PictureRecord, as_other, coco
from cnca.scene.layers import Sighting

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

PER_TAR = 1000
SHEET = 16
"""Pictures on the contact sheet."""


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
        content |= {
            "occluded": round(occluded, 4),
            "others": [as_json(as_other(o)) for o in others],
        }
        write_json(self.path("records", index), content)

    def indices(self) -> list[int]:
        """Numbers of all pictures that are done."""
        return sorted(int(path.stem) for path in (self.folder / "records").glob("*.json"))

    def entry(self, index: int) -> Entry:
        """What is known of a picture that is done; raises RunError where that is damaged."""
        path, advice = self.path("records", index), "delete it to make the picture again"
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except ValueError:
            raise RunError(f"{path}: damaged; {advice}") from None
        return Entry(from_json(PictureRecord, content, path, advice=advice), content)

    def finish(self, *, tar: bool) -> None:
        """Write ``annotations.json``, the contact sheet and, if wanted, the tars."""
        indices = self.indices()
        entries = [self.entry(index) for index in indices]
        masks = (self._mask(index) for index in indices)
        write_json(self.folder / "annotations.json", as_json(coco(entries, masks, self.label)))
        if indices:
            self._write_sheet([entry.record for entry in entries])
        if tar:
            groups: dict[int, list[int]] = {}
            for index in indices:
                groups.setdefault(index // PER_TAR, []).append(index)
            for number, members in groups.items():
                self._write_tar(self.folder / "shards" / f"{number:06d}.tar", members)

    def _mask(self, index: int) -> Mask:
        return cv2.imread(str(self.path("masks", index)), cv2.IMREAD_GRAYSCALE) / 255

    def _write_sheet(self, records: Sequence[PictureRecord]) -> None:
        chosen = records[:: max(1, len(records) // SHEET)][:SHEET]
        tiles = []
        for record in chosen:
            picture = cv2.imread(str(self.path("images", record.index)))[..., ::-1]
            box = torch.tensor(record.box_xyxy)
            tiles.append(draw_boxes(np.ascontiguousarray(picture), None, [], box))
        captions = [record.caption or str(record.index) for record in chosen]
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
    box_xyxy: Box


def extent_of(mask: Mask) -> Extent:
    """Size of the picture and box of all pixels that the vehicle touches, xyxy."""
    left, top, width, height = cv2.boundingRect((mask > 0).astype(np.uint8))
    box = left, top, left + width, top + height
    if width == 0:
        raise RunError("a picture without the vehicle has no place in the data set")
    height, width = mask.shape
    return Extent(height, width, box)
