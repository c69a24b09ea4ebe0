"""The built-in detectors: one contract, whether they are trained yet or not, and their sizes."""

import json

import numpy as np
import pytest
import torch

from cnca.core.errors import CncaError, DetectorError, RunError
from cnca.detect import BUILTINS, TRAINED, detector_files, load_detector
from cnca.train.detector.builtin import train_builtin
from cnca.train.detector.dataset import LabelledPictures
from cnca.train.detector.obstacles import CLASSES
from cnca.train.detector.request import DetectorRequest
from cnca.train.detector.training import DetectorTask, Settings, start
from cnca.train.detector.yolo_loss import Targets
from cnca.train.loop import TrainingState
from tests.detect.test_detectors import DetectorContract

LARGEST = 15e6
"""Bytes of all weights together."""


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """Two grey pictures, one with a white car."""
    folder = tmp_path_factory.mktemp("pictures")
    images = np.full((2, 256, 256, 3), 90, np.uint8)
    images[0, 100:160, 60:180] = 255
    np.save(folder / "images.npy", images)
    labels = {"class_names": [*CLASSES], "boxes": [[[60, 100, 180, 160, 0]], []]}
    labels |= {"group": ["plain", "empty"], "split": ["train", "train"]}
    (folder / "labels.json").write_text(json.dumps(labels))
    return LabelledPictures(folder)


@pytest.fixture(scope="module", params=TRAINED)
def subject(request, pictures, tmp_path_factory):
    """A new network of each kind, at its full size."""
    out = tmp_path_factory.mktemp(request.param)
    return start(pictures, TRAINED[request.param], out, Settings())


@pytest.fixture(scope="module")
def untrained(subject):
    """It as a detector, by way of its files."""
    return load_detector(str(subject.save(subject.network)))


class TestRandomWeights(DetectorContract):
    @pytest.fixture
    def detector(self, untrained):
        return untrained

    def test_knows_cars_from_obstacles(self, detector):
        assert detector.class_names == CLASSES


def test_loss_falls(subject, pictures, monkeypatch):
    """A few steps on the same two pictures."""
    images = torch.from_numpy(np.array(pictures.pictures)).permute(0, 3, 1, 2).float() / 255
    boxes = torch.from_numpy(pictures.boxes[0][:, :4]).float()
    targets = Targets(boxes, torch.zeros(1, dtype=torch.long), torch.zeros(1, dtype=torch.long))
    monkeypatch.setattr(DetectorTask, "batch", lambda *_: (images, targets))
    task = DetectorTask(subject, pictures, Settings(epochs=100, batch=2, bfloat16=False))
    state = TrainingState(task, seed=0)
    losses = [state.step(5) for _ in range(12)]  # where the step size is the largest
    assert losses[-1] < 0.7 * losses[0]


def test_transformers_proposals_begin_at_usual_size(pictures, tmp_path):
    """Not at the size of the library's anchors; and signal reaches the decoder."""
    network = start(pictures, TRAINED["transformer"], tmp_path, Settings()).network
    with torch.no_grad():
        found = network(pixel_values=torch.rand(4, 3, 256, 256))
    sizes = found.enc_outputs_coord_logits.sigmoid()[..., 2:]
    assert 0.15 < sizes.median() < 0.6
    assert all(features.std() > 0.1 for features in found.encoder_last_hidden_state)


def test_all_are_small(tmp_path, pictures):
    """All kinds together, as they are saved."""
    sizes = []
    for kind, template in TRAINED.items():
        subject = start(pictures, template, tmp_path / kind, Settings())
        subject.save(subject.network)
        sizes += [file.stat().st_size for file in (tmp_path / kind).rglob("*.safetensors")]
    assert len(sizes) == len(TRAINED)
    assert sum(sizes) < LARGEST


@pytest.mark.parametrize("name", BUILTINS)
def test_files(name):
    """What a manifest lists exists, and holds the architecture."""
    files = detector_files(name)
    assert files
    assert all(file.exists() for file in files)


def request(out, **more):
    return DetectorRequest(**{"out": out, "pictures": 15, "streets": 0, "epochs": 1} | more)


def test_unknown_kind(tmp_path):
    with pytest.raises(DetectorError, match="kind 'anchorfree': unknown; .*'anchor-free'"):
        train_builtin(request(tmp_path, kind="anchorfree"), resume=False)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"epochs": 0}, "--epochs 0: a training needs"),
        ({"pictures": 0}, "--pictures 0 --streets 0: give"),
        ({"held_out": ("Town04",)}, "--held-out: names frames; give --frames"),
    ],
)
def test_nothing_to_train(tmp_path, options, message):
    with pytest.raises(CncaError, match=message):
        train_builtin(request(tmp_path, **options), resume=False)


def test_a_folder_that_holds_a_training_is_refused_before_any_picture(tmp_path):
    (tmp_path / "yolo").mkdir()
    (tmp_path / "yolo" / "detector.pt").touch()
    with pytest.raises(RunError, match="yolo: already holds a training; add --resume"):
        train_builtin(request(tmp_path), resume=False)
    assert [path.name for path in tmp_path.iterdir()] == ["yolo"]
