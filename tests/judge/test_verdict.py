"""From detections to measures: cases whose numbers are known."""

import pytest
import torch

from cnca.core.errors import DetectorError
from cnca.core.types import Detections
from cnca.judge.bootstrap import Sampled, resample
from cnca.judge.scores import rank
from cnca.judge.truth import Truth
from cnca.judge.verdict import TOTAL, Seen, by_section, measure, measure_all, word_for

BOX = torch.tensor([0.0, 0.0, 10.0, 10.0])
NAMES = ("person", "car", "truck", "bus")


def seen(*views, names=NAMES):
    """One detection in the right place for each (label, score); None for an empty view."""
    found = []
    for view in views:
        pairs = [] if view is None else [view]
        labels = torch.tensor([label for label, _ in pairs], dtype=torch.long)
        scores = torch.tensor([score for _, score in pairs])
        found.append(Detections(BOX.expand(len(pairs), 4), scores, labels))
    return Seen(found, names)


def measured(now, before=None, column="car"):
    count = len(now.detections)
    weights = resample([count], seed=0, count=200)
    return measure(now, before, Truth(BOX.expand(count, 4)), weights, column)


def test_a_truck_is_a_vehicle_and_no_car():
    now = seen((1, 0.8), (2, 0.6), (0, 0.9), None)
    as_car, as_vehicle = measured(now), measured(now, column="vehicle")
    assert as_car["score"].value == pytest.approx(0.2)
    assert as_vehicle["score"].value == pytest.approx(0.35)
    assert as_car["AP_voc"].value == pytest.approx(0.25)
    assert as_vehicle["AP_voc"].value == pytest.approx(0.5)
    # Recall 1/4 reaches the thresholds 0, 0.1, 0.2 of 11 and 0 to 0.25 of 101.
    assert as_car["AP_voc11"].value == pytest.approx(3 / 11)
    assert as_car["AP_coco"].value == pytest.approx(26 / 101)


def test_success_counts_what_was_found_before_and_is_no_more():
    before = seen((1, 0.9), (1, 0.3), (1, 0.2), None)
    now = seen((1, 0.1), (1, 0.5), None, (1, 0.9))
    assert measured(now, before)["success"].value == pytest.approx(0.5)
    assert "success" not in measured(now)
    nothing = seen(None, None, None, None)
    assert measured(now, nothing)["success"].estimate().value is None


def test_a_detector_without_cars_is_named():
    with pytest.raises(DetectorError, match="no class 'car': it has person"):
        measured(seen((0, 0.5), names=("person",)))


def test_total_is_the_mean_over_detectors_with_its_own_interval():
    one, other = seen(*[(1, 0.9)] * 8), seen(*[(1, 0.9)] * 4, *[None] * 4)
    weights = resample([8], seed=0, count=500)
    table = measure_all(
        {"normal": {"a": one, "b": other}}, Truth(BOX.expand(8, 4)), weights, normal="normal"
    )
    total = table["normal"][TOTAL]["car"]["AP_voc"]
    assert total.value == pytest.approx(0.75)
    low, high = table["normal"]["b"]["car"]["AP_voc"].interval()
    assert total.interval() == pytest.approx(((1 + low) / 2, (1 + high) / 2))
    assert low < 0.5 < high


def test_sections_count_their_own_views():
    now = seen((1, 0.9), None, (1, 0.8), (1, 0.7))
    weights = resample([4], seed=0, count=50)
    parts = by_section({"a": now}, Truth(BOX.expand(4, 4)), weights, [[0, 2], [1, 3]])
    assert [part.value for part in parts] == pytest.approx([1.0, 0.5])


@pytest.mark.parametrize(
    ("samples", "word"),
    [
        ([-1.0, -2.0, -1.0], "lower"),
        ([0.1, 0.1, 0.2], "higher"),
        ([-1.0, -2.0, 0.5], "no difference"),
    ],
)
def test_a_difference_within_its_interval_is_none(samples, word):
    assert word_for(Sampled(torch.tensor([-0.5, *samples])), 20) == word
    assert word_for(Sampled(torch.zeros(5)), 20) == "no difference"


def test_a_few_views_decide_nothing():
    """Both found before, none after: resamples of two views do not vary."""
    before, after = measured(seen((1, 0.9), (1, 0.9))), measured(seen(None, None))
    difference = after["AP_voc"] - before["AP_voc"]
    assert difference.interval() == (-1, -1)
    assert word_for(difference, 2) == "too few views"


def test_equal_textures_are_called_different_as_rarely_as_the_level_says():
    """100 pairs of textures that a detector finds with the same chance of one half."""
    weights = resample([40], seed=0, count=200)
    truths, wrong = [BOX[None]] * 40, 0
    chance = torch.Generator().manual_seed(1)
    for _ in range(100):
        pair = []
        for _ in range(2):
            scores = torch.rand(40, generator=chance).tolist()
            found = seen(*[(0, score) if score > 0.5 else None for score in scores]).detections
            pair.append(Sampled(rank(found, truths, 0).average_precision(weights)))
        wrong += word_for(pair[0] - pair[1], 40) != "no difference"
    # 5 % plus what percentile intervals miss at 40 views (1 %), and four binomial σ of 2.4 %.
    assert wrong / 100 < 0.06 + 4 * 0.024
