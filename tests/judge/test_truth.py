"""Other vehicles in the picture: left out, or to be found."""

import pytest
import torch

from cnca.core.errors import RunError
from cnca.core.types import Detections
from cnca.jobs.evaluate.request import EvaluationRequest
from cnca.judge.bootstrap import resample
from cnca.judge.truth import Other, Truth
from cnca.judge.verdict import Seen, by_section, measure

CAR, TRUCK, PERSON = 0, 1, 2
NAMES = ("car", "truck", "person")
OWN, OTHER, WALL = (0.0, 0, 20, 20), (60.0, 0, 80, 20), (160.0, 0, 180, 20)


def truth(choice, *others, views=3):
    return Truth(torch.tensor([OWN] * views), [list(others)] * views, choice)


def value(truth, *found, column="car", label="car", measure_name="AP_voc"):
    """A measure where each view has these detections, (box, class) each, less and less sure."""
    boxes = torch.tensor([box for box, _ in found])
    scores = torch.linspace(0.9, 0.5, len(found))
    one = Detections(boxes, scores, torch.tensor([number for _, number in found]))
    weights = resample([len(truth)], seed=0, count=20)
    seen = Seen([one] * len(truth), NAMES, label)
    return measure(seen, None, truth, weights, column)[measure_name].value


@pytest.mark.parametrize("kind", ["AP_voc", "AP_voc11", "AP_coco"])
def test_an_ignored_vehicle_is_neither_hit_nor_false_alarm(kind):
    around = truth("ignore", Other("car", OTHER, 0.0))
    found = ((OTHER, CAR), (OWN, CAR))
    assert value(around, *found, measure_name=kind) == pytest.approx(1)
    assert value(truth("ignore"), *found, measure_name=kind) == pytest.approx(0.5, abs=0.01)
    assert value(around, (WALL, CAR), (OWN, CAR), measure_name=kind) == pytest.approx(0.5, abs=0.01)
    assert value(around, (OTHER, CAR), measure_name=kind) == 0, "the vehicle itself is not found"


def test_vehicles_of_every_kind_are_ignored_and_people_are_not():
    found = ((OTHER, CAR), (OWN, CAR))
    for label, expected in (("truck", 1), ("Bus", 1), ("person", 0.5)):
        around = truth("ignore", Other(label, OTHER, 0.0))
        assert value(around, *found) == pytest.approx(expected)


def test_a_counted_vehicle_is_one_to_find():
    around = truth("count", Other("car", OTHER, 0.3))
    assert value(around, (OTHER, CAR), (OWN, CAR)) == pytest.approx(1)
    assert value(around, (OWN, CAR)) == pytest.approx(0.5), "half of the objects"
    assert value(around, (WALL, CAR), (OWN, CAR)) == pytest.approx(0.25)


def test_a_counted_truck_is_a_false_alarm_as_a_car_and_a_hit_as_a_vehicle():
    around = truth("count", Other("truck", OTHER, 0.0))
    found = ((OTHER, CAR), (OWN, CAR))
    assert value(around, *found) == pytest.approx(0.5)
    assert value(around, *found, column="vehicle") == pytest.approx(1)


def test_a_counted_vehicle_that_is_all_but_hidden_is_ignored():
    around = truth("count", Other("car", OTHER, 0.9))
    assert value(around, (OWN, CAR)) == pytest.approx(1)
    assert value(around, (OTHER, CAR), (OWN, CAR)) == pytest.approx(1)


def test_a_counted_vehicle_that_is_far_away_is_ignored():
    small = (60.0, 0, 70, 20)
    around = truth("count", Other("car", small, 0.0))
    assert value(around, (OWN, CAR)) == pytest.approx(1)
    assert value(around, (small, CAR), (OWN, CAR)) == pytest.approx(1)


def test_the_score_is_of_the_vehicle_alone():
    around = truth("count", Other("car", OTHER, 0.0))
    score = value(around, (OTHER, CAR), (OWN, CAR), measure_name="score")
    assert score == pytest.approx(0.5)


def test_sections_leave_out_the_same():
    around = truth("ignore", Other("car", OTHER, 0.0), views=2)
    boxes = torch.tensor([OTHER, OWN])
    one = Detections(boxes, torch.tensor([0.9, 0.5]), torch.zeros(2, dtype=torch.long))
    weights = resample([2], seed=0, count=20)
    (section,) = by_section({"d": Seen([one] * 2, NAMES)}, around, weights, [[1]])
    assert section.value == pytest.approx(1)


def test_a_part_has_its_own_views():
    boxes = torch.arange(12.0).reshape(3, 4)
    others = [[Other("car", OTHER, k / 10)] for k in range(3)]
    whole = Truth(boxes, others, "count")
    for views in ([2, 0], slice(1, 3)):
        part = whole.part(views)
        numbers = [0, 1, 2][views] if isinstance(views, slice) else views
        assert torch.equal(part.boxes, boxes[numbers])
        assert [view[0].occluded for view in part.others] == [k / 10 for k in numbers]
        assert part.choice == "count"


def test_another_choice_is_refused(tmp_path):
    with pytest.raises(RunError, match="--others ignor: .* did you mean 'ignore'"):
        EvaluationRequest(tmp_path, (tmp_path,), others="ignor")
