"""The measures of others, in cases that can be counted by hand."""

import math

import pytest
import torch

from cnca.core.types import Detections
from cnca.judge.bootstrap import resample
from cnca.judge.protocol_names import MEASURES, PROTOCOLS
from cnca.judge.protocols import measure_by_protocols
from cnca.judge.rows import COUNT
from cnca.judge.truth import Other, Truth

BOX, ELSEWHERE = [0.0, 0.0, 10.0, 10.0], [50.0, 50.0, 60.0, 60.0]


def view(*hits, alarms=()):
    """Detections of these confidences at the vehicle and beside it, best first."""
    pairs = sorted([(s, BOX) for s in hits] + [(s, ELSEWHERE) for s in alarms], reverse=True)
    boxes = torch.tensor([box for _, box in pairs]).reshape(-1, 4)
    scores = torch.tensor([score for score, _ in pairs])
    return Detections(boxes, scores, torch.zeros(len(pairs), dtype=torch.long))


def measured(found, clean=None, **truth):
    boxes = torch.tensor(BOX).expand(len(found), 4)
    weights = resample([len(found)], seed=0, count=100)
    clean = found if clean is None else clean
    values = measure_by_protocols(found, clean, Truth(boxes, **truth), weights, "car", "car")
    assert set(values) == set(MEASURES)
    return {name: sampled.value for name, sampled in values.items()}


def test_each_cut_has_its_own_ap():
    values = measured([view(0.9), view(0.3), view(0.1), view(0.003)])
    assert values["AP_001"] == pytest.approx(1)
    assert [values[f"AP_{cut}"] for cut in ("05", "25", "50")] == pytest.approx([0.75, 0.5, 0.25])
    assert values["found_50"] == pytest.approx(0.25)
    assert values["ASR_rpga"] == pytest.approx(0.75)


def test_success_of_padetbench_is_relative_to_the_clean_ap():
    clean = [view(0.9), view(0.9), None or view(), view()]
    values = measured([view(0.9), view(), view(), view()], clean)
    # Recall 0.25 reaches 26 of 101 thresholds, recall 0.5 reaches 51.
    assert values["ASR_padetbench"] == pytest.approx(1 - 26 / 51)


def test_other_vehicles_are_false_alarms_to_r_pga_alone():
    others = [[Other("car", tuple(ELSEWHERE), 0.0)], []]
    found = [view(0.6, alarms=[0.9]), view(0.5)]
    ignoring, counting = (
        measured(found, others=others),
        measured(found, others=others, choice=COUNT),
    )
    assert ignoring["AP_001"] == counting["AP_001"] == pytest.approx(1)
    # The first of three is the other car: precision 1/2 and then 2/3, the higher one throughout.
    assert ignoring["AP_rpga"] == counting["AP_rpga"] == pytest.approx(2 / 3)


def test_the_miss_rate_is_read_where_clean_pictures_have_a_tenth_of_a_false_alarm():
    """Ten views may have one false alarm: the second one, of 0.4, is the threshold."""
    clean = [view(0.9, alarms=[0.7]), view(0.9, alarms=[0.4]), *[view(0.9)] * 8]
    found = [view(0.5)] * 3 + [view(0.4)] * 3 + [view()] * 4
    assert measured(found, clean)["miss_01"] == pytest.approx(0.7)
    assert measured(found, [view(0.9)] * 10)["miss_01"] == pytest.approx(0.4)


def test_log_average_miss_rate():
    """Of ten views eight are found before the only false alarm, which is 0.1 a picture."""
    found = [view(0.9)] * 8 + [view(0.3, alarms=[0.5]), view()]
    # At 0.01, 0.018, 0.032, 0.056 two in ten are missed; at 0.1 and the four above it one in ten.
    expected = math.exp((4 * math.log(0.2) + 5 * math.log(0.1)) / 9)
    assert measured(found)["LAMR"] == pytest.approx(expected)


def test_protocols_name_measures_that_there_are():
    assert {name for names in PROTOCOLS.values() for name in names} <= set(MEASURES)
