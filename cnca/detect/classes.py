"""Lists of classes that detectors are trained on, and which of them are vehicles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from cnca.core.errors import DetectorError, did_you_mean
from cnca.core.text import read_text

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
"""The name given to a number that no class has."""
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
"""Classes that a vehicle on a road may be reported as to count in the column ``vehicle``."""
GENERIC = ("bicycle", "car", "motorbike", "aeroplane", "bus", "train", "truck", "boat")
"""What a class called ``vehicle`` stands for: COCO's supercategory of that name."""
SYNONYMS = {"motorcycle": "motorbike", "airplane": "aeroplane"}
"""Other names of the same classes, such as those in COCO's own files and torchvision."""
LISTED = 10
"""Classes that an error message lists."""


def read_names(path: Path) -> list[str]:
    """The class names in a file, one per line.

    Raises:
        DetectorError: the file cannot be read.
    """
    try:
        names = read_text(path, DetectorError).split("\n")
    except OSError as error:
        raise DetectorError(f"{path}: names cannot be read ({error})") from error
    return [name.strip() for name in names if name.strip()]


def known_name(name: str) -> str:
    """The one name that a class has here, whatever its case and spelling."""
    name = name.strip().lower()
    return SYNONYMS.get(name, name)


def counted(label: str = CAR) -> dict[str, tuple[str, ...]]:
    """Column → the classes that count in it, for a vehicle that is a ``label``.

    One column holds the class alone.  The other, ``vehicle``, also holds the classes that a vehicle
    on a road is mistaken for: to be found as a truck is to be found.
    """
    label = known_name(label)
    wider = tuple(dict.fromkeys([*VEHICLES, label]))
    return {label: (label,), VEHICLE: wider} if label != VEHICLE else {VEHICLE: wider}


def vehicle_labels(
    class_names: Sequence[str], label: str = CAR, *, detector: str = "the detector"
) -> dict[str, tuple[int, ...]]:
    """Column of :func:`counted` → the detector's labels by which the vehicle counts as found.

    Case does not matter.  A detector that does not tell kinds of vehicles apart, but has a class
    ``vehicle`` or ``vehicles``, finds it as that: the class stands in both columns.

    Raises:
        DetectorError: there is no such class; names ``detector`` and the nearest class.
    """
    names, label = [known_name(name) for name in class_names], known_name(label)
    generic = tuple(i for i, name in enumerate(names) if name in (VEHICLE, "vehicles"))
    table = {
        column: tuple(i for i, name in enumerate(names) if name in classes)
        for column, classes in counted(label).items()
    }
    if not table[label] and label in (*GENERIC, VEHICLE):
        table[label] = generic
    if not table[label]:
        shown = ", ".join(class_names[:LISTED]) or "none"
        more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
        raise DetectorError(
            f"{detector} knows no class '{label}': it has {shown}{more}"
            f"{did_you_mean(label, class_names)}"
        )
    table[VEHICLE] = tuple(sorted({*table[VEHICLE], *generic, *table[label]}))
    return table
