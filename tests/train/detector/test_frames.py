"""Labelled frames become a data set, and what is wrong with them is said in one line."""

import json

import cv2
import numpy as np
import pytest

from cnca.core.errors import DetectorError
from cnca.train.detector.dataset import LabelledPictures, TrainingPictures
from cnca.train.detector.frames import gather_frames


@pytest.fixture
def folder(tmp_path):
    for name in ("images", "labels"):
        (tmp_path / name).mkdir()
    rng = np.random.default_rng(0)
    for town in ("A", "B"):
        for k in range(2):
            picture = rng.integers(0, 255, (40, 60, 3), np.uint8)
            cv2.imwrite(str(tmp_path / "images" / f"{town}_{k}.png"), picture)
            label = tmp_path / "labels" / f"{town}_{k}.txt"
            label.write_text("0 0.5 0.5 0.5 0.2\n3 0.1 0.1 0.1 0.1\n")
    return tmp_path


def test_vehicles_become_boxes_and_towns_groups(folder, tmp_path):
    gather_frames(folder, tmp_path / "out", held_out=["B"])
    data = LabelledPictures(tmp_path / "out")
    assert data.groups == ["A", "A", "B", "B"]
    assert data.split == ["train", "train", "test", "test"]
    np.testing.assert_allclose(data.boxes[0], [[15, 16, 45, 24, 0]])


def test_several_sets_are_joined(folder, tmp_path):
    gather_frames(folder, tmp_path / "out", held_out=["B"])
    data = LabelledPictures(tmp_path / "out", tmp_path / "out")
    assert len(data.pictures) == 8
    assert data.of_split("test") == [2, 3, 6, 7]


def test_other_classes_are_refused(folder, tmp_path):
    gather_frames(folder, tmp_path / "out")
    gather_frames(folder, tmp_path / "other")
    labels = tmp_path / "other" / "labels.json"
    labels.write_text(json.dumps(json.loads(labels.read_text()) | {"class_names": ["bus"]}))
    with pytest.raises(DetectorError, match="class_names are"):
        LabelledPictures(tmp_path / "out", tmp_path / "other")


def test_an_unknown_group_is_refused(folder, tmp_path):
    with pytest.raises(DetectorError, match="--held-out C: no frame is named so; there are A, B"):
        gather_frames(folder, tmp_path / "out", held_out=["C"])


def test_a_broken_label_names_its_line(folder, tmp_path):
    (folder / "labels" / "A_0.txt").write_text("0 0.5 0.5 0.5 0.2\n0 0.5 x 0.5 0.2\n")
    with pytest.raises(DetectorError, match="A_0.txt: line 2"):
        gather_frames(folder, tmp_path / "out")


def test_an_empty_folder_is_refused(tmp_path):
    with pytest.raises(DetectorError, match="no .jpg or .png"):
        gather_frames(tmp_path, tmp_path / "out")


def test_a_detector_learns_only_the_classes_that_it_tells_apart(folder, tmp_path):
    """One that knows vehicles alone is not shown obstacles."""
    gather_frames(folder, tmp_path / "out")
    data = LabelledPictures(tmp_path / "out")
    data.boxes = [np.array([[15.0, 16, 45, 24, 0], [10.0, 20, 40, 30, 1]]) for _ in data.boxes]
    seen = {
        classes: {label for _, rows in _epochs(data, classes) for label in rows[:, 4]}
        for classes in (1, 2)
    }
    assert seen == {1: {0.0}, 2: {0.0, 1.0}}


def _epochs(data, classes):
    pictures = TrainingPictures(data, (40, 60), 0, classes=classes)
    return [pictures[k] for k in range(len(pictures))]
