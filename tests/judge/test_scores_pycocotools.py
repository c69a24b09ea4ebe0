"""Average precision against pycocotools and against a second, slower implementation."""

import contextlib
import io

import numpy as np
import pytest
import torch

from cnca.core.types import Detections
from cnca.judge.scores import as_one_class, average_precision, rank

CAR = 2
COCO = pytest.importorskip("pycocotools.coco").COCO
COCOeval = pytest.importorskip("pycocotools.cocoeval").COCOeval


def draw(seed, *, images=12, crowded=False, levels=None):
    """Random objects and detections; every third image is empty of one or of both.

    ``crowded`` puts objects so near each other that one detection overlaps several; ``levels``
    rounds the confidences, so that there are ties within and across images.
    """
    rng = np.random.default_rng(seed)
    detections, truths = [], []
    for image in range(images):
        count = 0 if image % 3 == 0 else int(rng.integers(1, 5))
        corners = rng.integers(0, 12 if crowded else 300, size=(count, 2)).astype(float)
        if not crowded:
            corners += 400 * np.arange(count)[:, None]
        truth = np.concatenate([corners, corners + rng.integers(20, 60, size=(count, 2))], axis=1)
        near = np.repeat(truth, 3, axis=0) + rng.integers(-12, 13, size=(3 * count, 4))
        far = rng.integers(5000, 6000, size=(0 if image % 6 == 3 else 3, 2)).astype(float)
        boxes = np.concatenate([near, np.concatenate([far, far + 30], axis=1)])
        scores = rng.random(len(boxes))
        if levels:
            scores = np.ceil(scores * levels) / levels
        labels = np.where(rng.random(len(boxes)) < 0.85, CAR, 7)
        detections.append(
            Detections(
                torch.from_numpy(boxes), torch.from_numpy(scores), torch.from_numpy(labels).long()
            )
        )
        truths.append(torch.from_numpy(truth))
    return detections, truths


def pycocotools_precisions(detections, truths, recalls, crowds=None):
    """Interpolated precision at each of ``recalls``, IoU 0.5, all areas, 100 detections."""

    def xywh(box):
        left, top, right, bottom = box.tolist()
        return [left, top, right - left, bottom - top]

    objects = [(image, xywh(box)) for image, boxes in enumerate(truths) for box in boxes]
    rows = [(image, box, 0) for image, box in objects]
    rows += [(i, xywh(box), 1) for i, boxes in enumerate(crowds or []) for box in boxes]
    annotations = [
        {"id": k + 1, "image_id": i, "category_id": CAR, "bbox": b, "area": 1.0, "iscrowd": crowd}
        for k, (i, b, crowd) in enumerate(rows)
    ]
    found = [
        {"image_id": image, "category_id": int(label), "bbox": xywh(box), "score": float(score)}
        for image, each in enumerate(detections)
        for box, score, label in zip(each.boxes, each.scores, each.labels, strict=True)
    ]
    with contextlib.redirect_stdout(io.StringIO()):
        truth = COCO()
        truth.dataset = {
            "info": {},
            "images": [{"id": image} for image in range(len(truths))],
            "categories": [{"id": CAR, "name": "car"}, {"id": 7, "name": "truck"}],
            "annotations": annotations,
        }
        truth.createIndex()
        judge = COCOeval(truth, truth.loadRes(found), "bbox")
        judge.params.catIds = [CAR]
        judge.params.iouThrs = np.array([0.5])
        judge.params.areaRng, judge.params.areaRngLbl = [[0, 1e10]], ["all"]
        if recalls is not None:
            judge.params.recThrs = recalls
        judge.evaluate()
        judge.accumulate()
    return judge.eval["precision"][0, :, 0, 0, -1]


CASES = [{}, {"levels": 4}, {"levels": 1}, {"crowded": True}, {"crowded": True, "levels": 3}]


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("case", CASES)
def test_coco_equals_pycocotools(seed, case):
    detections, truths = draw(seed, **case)
    expected = pycocotools_precisions(detections, truths, None).mean()
    assert 0 < expected < 1
    # pycocotools adds a machine epsilon to its divisor; nothing else differs.
    found = average_precision(detections, truths, CAR, kind="coco")
    assert found == pytest.approx(expected, abs=1e-12)


def regions(seed, truths):
    """Some regions in each image: over objects, beside them, and where the false alarms lie."""
    rng, drawn = np.random.default_rng(100 + seed), []
    for boxes in truths:
        near = boxes[rng.random(len(boxes)) < 0.5].numpy() + rng.integers(-30, 31, size=4)
        near[:, 2:] = np.maximum(near[:, 2:], near[:, :2] + 5)
        far = rng.integers(5000, 6000, size=(3, 2)).astype(float)
        drawn.append(torch.from_numpy(np.concatenate([near, np.hstack([far, far + 300])])))
    return drawn


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("case", CASES)
def test_ignored_regions_are_pycocotools_crowds(seed, case):
    detections, truths = draw(seed, **case)
    ignored = regions(seed, truths)
    expected = pycocotools_precisions(detections, truths, None, ignored).mean()
    once = torch.ones(1, len(truths), dtype=torch.float64)
    ranking = rank(detections, truths, CAR, kind="coco", ignored=ignored)
    found = float(ranking.average_precision(once))
    assert found == pytest.approx(expected, abs=1e-12)
    assert found != average_precision(detections, truths, CAR, kind="coco")


@pytest.mark.parametrize("kind", ["voc", "voc11", "coco"])
def test_what_lies_in_an_ignored_region_changes_nothing(kind):
    """Detections there, and those moved out of the pictures, come to the same."""
    car, other, wall = [0.0, 0, 10, 10], [30.0, 0, 40, 10], [80.0, 0, 90, 10]
    truths, ignored = [torch.tensor([car])], [torch.tensor([[28.0, 0, 60, 12]])]
    once = torch.ones(1, 1, dtype=torch.float64)

    def value(*boxes, regions=None):
        scores = torch.linspace(0.9, 0.5, len(boxes))
        found = [Detections(torch.tensor(boxes), scores, torch.full((len(boxes),), CAR))]
        ranking = rank(found, truths, CAR, kind=kind, ignored=regions)
        return float(ranking.average_precision(once))

    assert value(other, car) < 1
    assert value(other, car, regions=ignored) == pytest.approx(1)
    assert value(wall, car, regions=ignored) == value(wall, car) == value(other, car)
    over_the_car = [torch.tensor([[0.0, 0, 60, 12]])]
    assert value(car, regions=over_the_car) == pytest.approx(1)  # found, whatever lies around it


@pytest.mark.parametrize("seed", range(6))
def test_voc_equals_pycocotools_at_its_own_recalls(seed):
    """Without ties and crowds both match alike; the area is the mean over the recalls k / n."""
    detections, truths = draw(seed)
    objects = sum(map(len, truths))
    every = pycocotools_precisions(detections, truths, np.arange(1, objects + 1) / objects)
    eleven = pycocotools_precisions(detections, truths, np.arange(11) / 10)
    area = average_precision(detections, truths, CAR)
    assert area == pytest.approx(every.mean(), abs=1e-12)
    voc11 = average_precision(detections, truths, CAR, kind="voc11")
    assert voc11 == pytest.approx(eleven.mean(), abs=1e-12)


def voc_points(detections, truths):
    """Recall and precision at each confidence, from VOC's rule without an order of detections.

    At a confidence the hits are the objects that are nearest to some detection of at least it.
    """
    rows = []
    for image, (found, boxes) in enumerate(zip(detections, truths, strict=True)):
        for box, score, label in zip(found.boxes, found.scores, found.labels, strict=True):
            if label != CAR:
                continue
            overlaps = [overlap(box.tolist(), other) for other in boxes.tolist()]
            best = max(overlaps, default=0.0)
            rows.append((float(score), (image, overlaps.index(best)) if best >= 0.5 else None))
    objects = sum(map(len, truths))
    points = []
    for confidence in {score for score, _ in rows}:
        reported = [hit for score, hit in rows if score >= confidence]
        hits = len({hit for hit in reported if hit})
        points.append((hits / objects, hits / len(reported)))
    return points


def overlap(one, other):
    width = min(one[2], other[2]) - max(one[0], other[0])
    height = min(one[3], other[3]) - max(one[1], other[1])
    if width <= 0 or height <= 0:
        return 0.0
    areas = [(box[2] - box[0]) * (box[3] - box[1]) for box in (one, other)]
    return width * height / (sum(areas) - width * height)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("case", CASES)
def test_voc_equals_its_definition_with_ties_and_crowds(seed, case):
    detections, truths = draw(seed, **case)
    points = voc_points(detections, truths)
    highest = {r: max(p for other, p in points if other >= r) for r, _ in points}
    area, before = 0.0, 0.0
    for recall in sorted(highest):
        area, before = area + (recall - before) * highest[recall], recall
    eleven = [max((p for r, p in points if r >= k / 10), default=0.0) for k in range(11)]
    assert average_precision(detections, truths, CAR) == pytest.approx(area, abs=1e-12)
    found = average_precision(detections, truths, CAR, kind="voc11")
    assert found == pytest.approx(sum(eleven) / 11, abs=1e-12)


def test_coco_counts_a_hundred_detections_of_an_image():
    """The only hit is the 101st: COCO does not see it, VOC does."""
    miss, hit = [50.0, 50.0, 60.0, 60.0], [0.0, 0.0, 10.0, 10.0]
    boxes = torch.tensor([miss] * 100 + [hit])
    detections = [Detections(boxes, torch.linspace(0.9, 0.1, 101), torch.full((101,), CAR))]
    truths = [torch.tensor([hit])]
    assert average_precision(detections, truths, CAR, kind="coco") == 0
    assert pycocotools_precisions(detections, truths, None).mean() == 0
    assert average_precision(detections, truths, CAR) == pytest.approx(1 / 101)


def test_a_detection_between_two_objects_tells_the_matchings_apart():
    """Two equal detections on two objects that overlap: COCO gives the second the other object."""
    one, other = [0.0, 0.0, 10.0, 10.0], [0.0, 0.0, 10.0, 8.0]
    boxes = torch.tensor([one, one])
    detections = [Detections(boxes, torch.tensor([0.9, 0.8]), torch.full((2,), CAR))]
    truths = [torch.tensor([one, other])]
    assert average_precision(detections, truths, CAR, kind="coco") == pytest.approx(1)
    assert average_precision(detections, truths, CAR) == pytest.approx(0.5)


@pytest.mark.parametrize("kind", ["voc", "voc11", "coco"])
@pytest.mark.parametrize("seed", range(4))
def test_weights_count_an_image_as_often_as_repeating_it(seed, kind):
    detections, truths = draw(seed, images=7)
    times = np.random.default_rng(seed).integers(0, 3, size=7)
    times[1] = 1  # an image with objects
    repeated = [i for i, n in enumerate(times) for _ in range(n)]
    expected = average_precision(
        [detections[i] for i in repeated], [truths[i] for i in repeated], CAR, kind=kind
    )
    weights = torch.from_numpy(np.stack([times, np.ones(7)])).double()
    found = rank(detections, truths, CAR, kind=kind).average_precision(weights)
    assert found[0].item() == pytest.approx(expected)
    assert found[1].item() == pytest.approx(average_precision(detections, truths, CAR, kind=kind))


def test_without_counted_objects_the_value_is_undefined():
    detections, truths = draw(0, images=4)
    weights = torch.tensor([[1.0, 0, 0, 0]]).double()  # image 0 is empty
    for kind in ("voc", "voc11", "coco"):
        assert rank(detections, truths, CAR, kind=kind).average_precision(weights).isnan().all()


def test_a_vehicle_reported_as_two_classes_is_one():
    boxes = torch.tensor([[0.0, 0, 10, 10], [0.0, 0, 10, 9], [40.0, 0, 50, 10], [0.0, 0, 10, 10]])
    found = Detections(boxes, torch.tensor([0.4, 0.7, 0.2, 0.9]), torch.tensor([2, 7, 5, 0]))
    merged = as_one_class(found, (2, 5, 7))
    assert merged.scores.tolist() == pytest.approx([0.7, 0.2])
    assert merged.labels.tolist() == [0, 0]
    assert len(as_one_class(found, (3,)).scores) == 0
