"""Annotations of a data set in COCO's object detection format."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cnca.detect.classes import CAR, COCO91, GENERIC, VEHICLE, known_name
from cnca.scene.layers import Sighting

COVERED = 0.5
"""Share of a pixel from which it belongs to COCO's segmentation."""

Mask = Float[np.ndarray, "height width"]
Box = tuple[int, int, int, int]


@dataclass(frozen=True)
class Category:
    """A class as COCO numbers it."""

    id: int
    name: str
    supercategory: str


@dataclass(frozen=True)
class RunLengths:
    """COCO's uncompressed run lengths: columns one after the other, first how many are empty."""

    size: tuple[int, int]
    """Height and width."""
    counts: list[int]


@dataclass(frozen=True)
class Other:
    """Another object of a picture."""

    label: str
    bbox: Box
    """Left, top, width and height in pixels."""
    area: int
    segmentation: RunLengths
    occluded: float
    """Share that something hides."""


@dataclass(frozen=True)
class PictureRecord:
    """What every record of a picture says, whatever else is known of it."""

    index: int
    box_xyxy: Box
    caption: str | None = None
    occluded: float = 0.0
    """Share of the vehicle that something hides."""
    others: Sequence[Other] = ()


@dataclass(frozen=True)
class Entry:
    """The record of a picture, and all that its file holds."""

    record: PictureRecord
    content: Mapping[str, object]


@dataclass(frozen=True)
class Annotation:
    """One object in one picture."""

    id: int
    image_id: int
    category_id: int
    bbox: Box
    """Left, top, width and height in pixels."""
    area: int
    segmentation: RunLengths
    iscrowd: int
    occluded: float
    """Share that something hides, which COCO's own annotations do not say."""


@dataclass(frozen=True)
class Coco:
    """The content of ``annotations.json``."""

    images: list[Mapping[str, object]]
    """``id`` and ``file_name``, and everything that the record says but the other objects."""
    annotations: list[Annotation]
    categories: list[Category]


def category(label: str) -> Category:
    """A class as COCO numbers it, so that detectors trained there need no other table.

    One that COCO does not have gets the first number after COCO's.
    """
    name = known_name(label)
    number = COCO91.index(name) if name in COCO91 else len(COCO91)
    return Category(number, name, VEHICLE if name in GENERIC else name)


def coco(entries: Sequence[Entry], masks: Iterable[Mask], label: str = CAR) -> Coco:
    """All pictures' objects.

    The vehicle comes first, numbered as its picture; then the other objects of a world, of their
    own categories.
    """
    images: list[Mapping[str, object]] = []
    annotations = []
    vehicle = category(label)
    for entry, mask in zip(entries, masks, strict=True):
        record = entry.record
        left, top, right, bottom = record.box_xyxy
        content = {key: value for key, value in entry.content.items() if key != "others"}
        images.append({"id": record.index, "file_name": f"{record.index:06d}.png"} | content)
        annotations.append(
            Annotation(
                id=record.index + 1,  # COCO's tools take 0 for "none"
                image_id=record.index,
                category_id=vehicle.id,
                bbox=(left, top, right - left, bottom - top),
                area=int((mask >= COVERED).sum()),
                segmentation=run_lengths(mask),
                iscrowd=0,
                occluded=record.occluded,
            )
        )
    first = max((annotation.id for annotation in annotations), default=0) + 1
    others = [(entry.record.index, other) for entry in entries for other in entry.record.others]
    annotations += [_annotation(first + k, *placed) for k, placed in enumerate(others)]
    kinds = {vehicle.name: vehicle}
    kinds |= {kind.name: kind for kind in (category(other.label) for _, other in others)}
    return Coco(images, annotations, list(kinds.values()))


def _annotation(number: int, image: int, other: Other) -> Annotation:
    return Annotation(
        id=number,
        image_id=image,
        category_id=category(other.label).id,
        bbox=other.bbox,
        area=other.area,
        segmentation=other.segmentation,
        iscrowd=0,
        occluded=other.occluded,
    )


def as_other(seen: Sighting) -> Other:
    """Another object of a picture, as records and COCO's annotations have it."""
    left, top, right, bottom = seen.box
    return Other(
        label=known_name(seen.label),
        bbox=(left, top, right - left, bottom - top),
        area=int(seen.mask.sum()),
        segmentation=run_lengths(seen.mask.astype(float)),
        occluded=round(seen.occluded, 4),
    )


def run_lengths(mask: Mask) -> RunLengths:
    """The pixels of which at least :data:`COVERED` is covered."""
    covered = (mask >= COVERED).T.ravel()
    changes = np.flatnonzero(np.diff(covered.astype(np.int8))) + 1
    starts = [0] if not covered[0] else [0, 0]
    counts = np.diff([*starts, *changes, covered.size])
    height, width = mask.shape
    return RunLengths((height, width), counts.tolist())
