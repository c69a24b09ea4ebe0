"""The paper's Table 2 from photographs: groups, ignored objects, numbers, files."""

import json

import cv2
import numpy as np
import pytest
import torch
from rich.console import Console

from cnca.core.errors import RunError
from cnca.jobs.evaluate import parts as evidence_parts
from cnca.jobs.evaluate import photos
from cnca.jobs.evaluate.photos import (
    evaluate_photos,
    judge_photos,
    read_photo,
)
from cnca.jobs.evaluate.request import PhotoRequest
from cnca.judge.photo import Photo
from cnca.judge.verdict import Seen
from tests.fakes import BOX, BrightnessDetector
from tests.judge.test_scores_pycocotools import draw, pycocotools_precisions

NAMES = ("person", "bicycle", "car")


def test_numbers_are_those_of_pycocotools(tmp_path):
    detections, truths = draw(3, images=15)
    labelled = [
        Photo(tmp_path / f"{i}.png", "normal", objects={"car": boxes.tolist()})
        for i, boxes in enumerate(truths)
    ]
    results = judge_photos(labelled, {"d": Seen(detections, NAMES)}, seed=0)
    expected = pycocotools_precisions(detections, truths, None).mean()
    found = results.all["normal"]["d"]["car"]["AP_coco"]
    assert found.value == pytest.approx(expected, abs=1e-4)  # rounded for JSON
    assert found.low < found.value < found.high
    assert results.comparisons == []


def test_crowds_are_neither_hit_nor_false_alarm(tmp_path):
    detections, truths = draw(3, images=15)
    crowds = [torch.tensor([[5000.0, 5000, 6100, 6100]]) for _ in truths]
    labelled = [
        Photo(tmp_path / f"{i}.png", "normal", None, {"car": boxes.tolist()}, crowds[i].tolist())
        for i, boxes in enumerate(truths)
    ]
    results = judge_photos(labelled, {"d": Seen(detections, NAMES)}, seed=0)
    expected = pycocotools_precisions(detections, truths, None, crowds).mean()
    assert expected > pycocotools_precisions(detections, truths, None).mean()
    found = results.all["normal"]["d"]["car"]["AP_coco"]
    assert found.value == pytest.approx(expected, abs=1e-4)  # rounded for JSON


@pytest.fixture
def request_for(tmp_path, monkeypatch):
    """Pictures of 12×12, bright in ``normal`` and dark in ``CNCA``, each with one car."""
    images, annotations = [], []
    for group, level in (("normal", 200), ("CNCA", 20)):
        for k in range(20):
            name = f"{group}/{k}.png"
            path = tmp_path / "photos" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(path), np.full((12, 12, 3), level + k, np.uint8))
            images.append({"id": len(images), "file_name": name, "width": 12, "height": 12})
            left, top, right, bottom = BOX.tolist()
            annotations.append(
                {
                    "image_id": len(images) - 1,
                    "category_id": 1,
                    "bbox": [left, top, right - left, bottom - top],
                }
            )
    labels = {
        "images": images,
        "annotations": annotations,
        "categories": [{"id": 1, "name": "car"}],
    }
    (tmp_path / "labels.json").write_text(json.dumps(labels))
    detector = BrightnessDetector()
    monkeypatch.setattr(evidence_parts.build, "build_detector", lambda spec: detector)
    monkeypatch.setattr(photos, "detector_files", lambda spec: [])
    monkeypatch.setattr(evidence_parts, "detector_files", lambda spec: [])

    def make(**options):
        where = tmp_path / "photos", tmp_path / "labels.json", tmp_path / "out"
        return PhotoRequest(*where, ("fake",), **options)

    return make, detector


def test_rows_are_folders_and_a_dark_car_is_a_truck(request_for):
    make, detector = request_for
    request = make(paper_figures=True)
    results = evaluate_photos(request, Console(quiet=True))
    assert results.rows == ["normal", "CNCA"]
    assert results.photos == {"normal": 20, "CNCA": 20}
    ap = {
        (row, column): results.all[row]["brightness"][column]["AP_voc"].value
        for row in results.rows
        for column in ("car", "vehicle")
    }
    assert ap == {
        ("normal", "car"): 1, ("normal", "vehicle"): 1, ("CNCA", "car"): 0, ("CNCA", "vehicle"): 1,
    }  # fmt: skip
    assert {found.verdict for found in results.comparisons} == {"lower"}
    text = (request.out / "results.md").read_text()
    assert "| CNCA | 0.000 [0.000, 0.000] | 0.363 |" in text
    assert "quoted from the paper" in text
    assert cv2.imread(str(request.out / "photos_brightness.png")) is not None
    assert (request.out / "manifest.json").exists()

    assert [line.split(" | ")[0] for line in text.splitlines()].count("| normal") == 1
    assert len(detector.looks) == 40
    assert evaluate_photos(make(), Console(quiet=True)) == results
    assert len(detector.looks) == 40
    assert "paper" not in (request.out / "results.md").read_text()


def test_pictures_of_another_size_than_labelled_are_refused(tmp_path):
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), np.zeros((12, 16, 3), np.uint8))
    assert read_photo(Photo(path, "g", (16, 12))).shape == (1, 3, 12, 16)
    with pytest.raises(RunError, match=r"has 16×12 pixels, its labels say 12×16"):
        read_photo(Photo(path, "g", (12, 16)))
    path.write_bytes(b"no picture")
    with pytest.raises(RunError, match="cannot be decoded"):
        read_photo(Photo(path, "g"))


def test_channels_are_red_green_blue(tmp_path):
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), np.full((2, 2, 3), (0, 0, 255), np.uint8))
    assert read_photo(Photo(path, "g"))[0, :, 0, 0].tolist() == [1, 0, 0]
