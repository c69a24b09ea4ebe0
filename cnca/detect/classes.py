"""Lists of classes that detectors are trained on, and which of them are vehicles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from cnca.core.errors import DetectorError

COCO = (
    "person", "bicycle", "car", "motorbike", "aeroplane", "bus", "train", "truck", "boat",
    "traffic light", "fire hydrant", "stop sign", "parking meter", "bench", "bird", "cat", "dog",
    "horse", "sheep", "cow", "elephant", "bear", "zebra", "giraffe", "backpack", "umbrella",
    "handbag", "tie", "suitcase", "frisbee", "skis", "snowboard", "sports ball", "kite",
    "baseball bat", "baseball glove", "skateboard", "surfboard", "tennis racket", "bottle",
    "wine glass", "cup", "fork", "knife", "spoon", "bowl", "banana", "apple", "sandwich", "orange",
    "broccoli", "carrot", "hot dog", "pizza", "donut", "cake", "chair", "sofa", "pottedplant",
    "bed", "diningtable", "toilet", "tvmonitor", "laptop", "mouse", "remote", "keyboard",
    "cell phone", "microwave", "oven", "toaster", "sink", "refrigerator", "book", "clock", "vase",
    "scissors", "teddy bear", "hair drier", "toothbrush",
)  # fmt: skip
"""The 80 classes of COCO (Lin et al. 2014) in the order that detectors trained on it use."""

NOTHING = "N/A"
"""The name of a number that no class has."""
_UNUSED = (0, 12, 26, 29, 30, 45, 66, 68, 69, 71, 83)
_USED = iter(COCO)
COCO91 = tuple(NOTHING if number in _UNUSED else next(_USED) for number in range(91))
"""COCO's classes by the numbers in its files, 0 to 90, of which eleven are unused."""

VOC = (
    "aeroplane", "bicycle", "bird", "boat", "bottle", "bus", "car", "cat", "chair", "cow",
    "diningtable", "dog", "horse", "motorbike", "person", "pottedplant", "sheep", "sofa", "train",
    "tvmonitor",
)  # fmt: skip
"""The 20 classes of Pascal VOC (Everingham et al. 2010)."""

CLASS_LISTS: Mapping[str, Sequence[str]] = {"coco": COCO, "coco91": COCO91, "voc": VOC}
"""Class lists by the names under which files and options ask for them."""

CAR, VEHICLE = "car", "vehicle"
VEHICLES = (CAR, "truck", "bus")
"""What the vehicle may be reported as in the column of any vehicle."""


def read_names(path: Path) -> list[str]:
    """The class names in a file, one per line.

    Raises:
        DetectorError: the file cannot be read.
    """
    try:
        names = path.read_text(encoding="utf-8").split("\n")
    except (OSError, UnicodeDecodeError) as error:
        raise DetectorError(f"{path}: names cannot be read ({error})") from error
    return [name.strip() for name in names if name.strip()]


def vehicle_labels(class_names: Sequence[str]) -> dict[str, tuple[int, ...]]:
    """Return, for ``car`` and for ``vehicle``, the labels as which the vehicle counts as found.

    ``car`` holds the label of that class alone, ``vehicle`` those of car, truck and bus, as far as
    ``class_names`` has them.  A detector whose only class is ``vehicle`` does not tell cars apart:
    its label stands in both.

    Raises:
        DetectorError: there is no such class.
    """
    names = [name.strip().lower() for name in class_names]
    if names == [VEHICLE]:
        return {CAR: (0,), VEHICLE: (0,)}
    if CAR not in names:
        known = ", ".join(class_names)
        raise DetectorError(f"the detector knows no class '{CAR}': it has {known}")
    any_vehicle = tuple(label for label, name in enumerate(names) if name in VEHICLES)
    return {CAR: (names.index(CAR),), VEHICLE: any_vehicle}
