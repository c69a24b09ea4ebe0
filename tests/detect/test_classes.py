"""Class lists, and as what the vehicle counts as found."""

import pytest

from cnca.core.errors import DetectorError
from cnca.detect.classes import COCO, COCO91, NOTHING, VOC, vehicle_labels


def test_names_of_coco():
    assert len(set(COCO)) == 80
    assert [COCO[i] for i in (0, 2, 7, 79)] == ["person", "car", "truck", "toothbrush"]
    assert len(VOC) == len(set(VOC)) == 20


def test_numbers_of_coco():
    """As COCO's annotation files number them."""
    numbers = {"person": 1, "car": 3, "stop sign": 13, "dog": 18, "backpack": 27, "toilet": 70}
    assert {name: COCO91.index(name) for name in numbers} == numbers
    assert COCO91[90] == "toothbrush"
    assert [name for name in COCO91 if name != NOTHING] == list(COCO)


@pytest.mark.parametrize(
    ("names", "car", "vehicle"),
    [
        (COCO, (2,), (2, 5, 7)),
        (COCO91, (3,), (3, 6, 8)),
        (VOC, (6,), (5, 6)),
        (("car",), (0,), (0,)),
        (("vehicle",), (0,), (0,)),
        (("Truck", "Car"), (1,), (0, 1)),
    ],
)
def test_vehicles(names, car, vehicle):
    assert vehicle_labels(names) == {"car": car, "vehicle": vehicle}


@pytest.mark.parametrize("names", [("person",), ("person", "vehicle"), ()])
def test_no_car(names):
    with pytest.raises(DetectorError, match="knows no class 'car'"):
        vehicle_labels(names)
