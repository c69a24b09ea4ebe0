"""Scores on cases counted by hand."""

import pytest
import torch

from cnca.core.types import Detections
from cnca.judge.scores import average_precision, detection_score

CAR = 0
HIT, OTHER, MISS = [0.0, 0.0, 10.0, 10.0], [20.0, 0.0, 30.0, 10.0], [50.0, 50.0, 60.0, 60.0]
NONE = torch.zeros(0, 4)


def found(*items, label=CAR):
    """Detections from (box, score) pairs."""
    boxes = torch.tensor([box for box, _ in items]).reshape(-1, 4)
    scores = torch.tensor([score for _, score in items])
    return Detections(boxes, scores, torch.full((len(items),), label))


def truth(*boxes):
    return torch.tensor(boxes).reshape(-1, 4)


class TestDetectionScore:
    def test_highest_of_the_right_place_and_class(self):
        here = found((HIT, 0.4), (HIT, 0.6), (MISS, 0.9))
        assert detection_score(here, torch.tensor(HIT), CAR) == pytest.approx(0.6)
        assert detection_score(here, torch.tensor(HIT), 1) == 0

    @pytest.mark.parametrize(("right", "expected"), [(5.0, 0.8), (4.9, 0.0)])
    def test_overlap_of_one_half_suffices(self, right, expected):
        here = found(([0.0, 0.0, right, 10.0], 0.8))
        assert detection_score(here, torch.tensor(HIT), CAR) == pytest.approx(expected)

    def test_nothing_found(self):
        assert detection_score(found(), torch.tensor(HIT), CAR) == 0


class TestAveragePrecision:
    def test_perfect(self):
        pairs = [found((HIT, 0.9)), found((OTHER, 0.3))], [truth(HIT), truth(OTHER)]
        assert average_precision(*pairs, CAR) == pytest.approx(1)

    def test_false_alarm_between_two_hits(self):
        """Precision 1 up to recall ½, then 2/3 up to recall 1."""
        here = [found((HIT, 0.9), (MISS, 0.8), (OTHER, 0.7))]
        assert average_precision(here, [truth(HIT, OTHER)], CAR) == pytest.approx(0.5 + 0.5 * 2 / 3)

    def test_second_hit_on_one_object_is_a_false_alarm(self):
        """The duplicate precedes the second object: precision 1, 1/2, 2/3."""
        here = [found((HIT, 0.9), (HIT, 0.8), (OTHER, 0.7))]
        assert average_precision(here, [truth(HIT, OTHER)], CAR) == pytest.approx(0.5 + 0.5 * 2 / 3)

    def test_missed_object_bounds_recall(self):
        here = [found((HIT, 0.9)), found()]
        assert average_precision(here, [truth(HIT), truth(HIT)], CAR) == pytest.approx(0.5)

    def test_false_alarm_in_an_empty_image_counts(self):
        here = [found((MISS, 0.9)), found((HIT, 0.8))]
        assert average_precision(here, [NONE, truth(HIT)], CAR) == pytest.approx(0.5)

    def test_ties_do_not_depend_on_order(self):
        """One hit and one false alarm of equal confidence: precision ½ at recall 1."""
        values = [
            average_precision([found(*items)], [truth(HIT)], CAR)
            for items in ([(HIT, 0.5), (MISS, 0.5)], [(MISS, 0.5), (HIT, 0.5)])
        ]
        assert values == pytest.approx([0.5, 0.5])

    def test_other_classes_are_ignored(self):
        here = [found((HIT, 0.9), label=7)]
        assert average_precision(here, [truth(HIT)], CAR) == 0

    def test_undefined_without_objects(self):
        with pytest.raises(ValueError, match="no image holds an object"):
            average_precision([found((HIT, 0.9))], [NONE], CAR)

    def test_images_and_truths_must_match(self):
        with pytest.raises(ValueError, match="zip"):
            average_precision([found((HIT, 0.9))], [truth(HIT), truth(HIT)], CAR)
