"""Class lists, and as what the vehicle counts as found."""

import pytest

from cnca.core.errors import DetectorError
from cnca.detect.classes import COCO, COCO91, NOTHING, VEHICLE, VOC, counted, vehicle_labels


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
        (("Vehicles", "bike"), (0,), (0,)),
        (("person", "vehicle"), (1,), (1,)),
        (("Truck", "Car"), (1,), (0, 1)),
        ((" CAR", "van", "vehicle"), (0,), (0, 2)),
    ],
)
def test_vehicles(names, car, vehicle):
    assert vehicle_labels(names) == {"car": car, "vehicle": vehicle}


@pytest.mark.parametrize(
    ("label", "names", "own", "vehicle"),
    [
        ("truck", COCO, (7,), (2, 5, 7)),
        ("Truck ", ("Car", "TRUCK"), (1,), (0, 1)),
        ("boat", COCO, (8,), (2, 5, 7, 8)),
        ("boat", ("person", "vehicle"), (1,), (1,)),
        ("motorcycle", COCO, (3,), (2, 3, 5, 7)),
        ("motorbike", ("Motorcycle", "truck"), (0,), (0, 1)),
        ("person", COCO, (0,), (0, 2, 5, 7)),
        ("vehicle", ("Vehicle", "sign"), (0,), (0,)),
    ],
)
def test_other_vehicles_than_cars(label, names, own, vehicle):
    table = vehicle_labels(names, label)
    assert table[VEHICLE] == vehicle
    assert table[next(iter(counted(label)))] == own


@pytest.mark.parametrize("names", [("person",), ("person", "bike"), ()])
def test_no_car(names):
    with pytest.raises(DetectorError, match="knows no class 'car'"):
        vehicle_labels(names)


def test_the_nearest_class_is_named():
    with pytest.raises(DetectorError, match=r"^d\.onnx knows no class 'trukc': it has .*truck'\?$"):
        vehicle_labels(COCO, "trukc", detector="d.onnx")
    with pytest.raises(DetectorError, match="no class 'person': it has car, vehicle$"):
        vehicle_labels(("car", "vehicle"), "person")
