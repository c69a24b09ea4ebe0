"""Readings of a graph that are told apart by a car in a picture; boxes are where it is."""

import numpy as np
import pytest
import torch

pytest.importorskip("onnx", reason="needs the package onnx to build graphs")

from cnca.core.boxes import iou_matrix
from cnca.detect import load_detector
from cnca.detect.conventions import CAR, reference_picture
from tests.detect.graphs import SIZE, write_graph

SIDE = 320
PARTS = np.array(CAR, np.float32) / SIDE
PIXELS = PARTS * [SIZE[1], SIZE[0], SIZE[1], SIZE[0]]
SWAPPED = [1, 0, 3, 2]


def outputs(box, label, names=("boxes", "labels", "scores")):
    arrays = (np.array([box], np.float32), np.array([label]), np.array([0.9], np.float32))
    return dict(zip(names, arrays, strict=True))


@pytest.mark.parametrize(
    ("box", "label", "note"),
    [
        (PIXELS, 2, ""),
        (PIXELS, 3, "boxes xyxy, units pixels, classes coco91"),
        (PARTS, 2, "boxes xyxy, units picture, classes coco"),
        (PIXELS[SWAPPED], 3, "boxes yxyx, units pixels, classes coco91"),
    ],
)
def test_the_reading_that_finds_the_car_is_taken(tmp_path, box, label, note):
    path = write_graph(tmp_path / "net.onnx", outputs(box, label))
    detector = load_detector(str(path))
    assert note in detector.note
    assert bool(note) == bool(detector.note)
    found = detector.detect(reference_picture())[0]
    assert detector.class_names[int(found.labels[0])] == "car"
    assert iou_matrix(found.boxes[:1], torch.tensor([CAR])).item() > 0.99


def test_what_the_user_says_is_never_tried_otherwise(tmp_path):
    path = write_graph(tmp_path / "net.onnx", outputs(PIXELS, 3))
    (tmp_path / "net.yaml").write_text("classes: coco\n")
    detector = load_detector(str(path))
    assert detector.class_names[3] == "motorbike"
    assert "does not find the car" in detector.note


def test_real_detectors_find_the_car_as_they_are_usually_read(detectors):
    for name in ("yolox_nano.onnx", "fastestdet.onnx"):
        assert load_detector(str(detectors / name)).note == ""


def test_the_small_inputs_that_failed(detectors):
    """TensorFlow's notation, and torchvision's label 3."""
    for name in ("tf_ssd", "tv_frcnn"):
        file = detectors.parent / "data" / "faults" / "onnx-tf-ssd" / f"{name}.onnx"
        if not file.is_file():
            pytest.skip("needs ../shared/data/faults")
        detector = load_detector(str(file))
        best = detector.detect(torch.rand(1, 3, 300, 300))[0]
        assert detector.class_names[int(best.labels[0])] == "car"
        assert best.boxes[0, 2] - best.boxes[0, 0] > best.boxes[0, 3] - best.boxes[0, 1]
