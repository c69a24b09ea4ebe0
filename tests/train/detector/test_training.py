"""The trainer learns, repeats itself, resumes, and refuses what it cannot use."""

import json

import numpy as np
import pytest
import torch

from cnca.core.boxes import cxcywh_to_xyxy
from cnca.core.errors import DetectorError, RunError
from cnca.core.records import as_json
from cnca.detect import load_detector
from cnca.detect.cfg import read_config
from cnca.detect.darknet import Darknet
from cnca.detect.white_box import DarknetDetector
from cnca.train.detector.accuracy import measure
from cnca.train.detector.anchors import cluster_anchors, write_anchors
from cnca.train.detector.augment import augment
from cnca.train.detector.dataset import LabelledPictures
from cnca.train.detector.training import DetectorTask, Settings, start, train_detector
from cnca.train.detector.yolo_loss import Targets, ciou, yolo_loss
from tests.detect.shapes import write_shapes

SMALL = """
[net]
width=64
height=64
channels=3
{body}
[convolutional]
filters=12
size=1
activation=linear
[yolo]
mask=0,1
anchors=10,10, 20,20
classes=1
num=2
"""
LAYER = (
    "[convolutional]\nbatch_normalize=1\nfilters={}\nsize=3\npad=1\nstride={}\nactivation=leaky\n"
)
SETTINGS = Settings(epochs=8, batch=16)


@pytest.fixture(scope="module")
def shapes(tmp_path_factory):
    return write_shapes(tmp_path_factory.mktemp("data") / "shapes", 400)


@pytest.fixture(scope="module")
def template(tmp_path_factory):
    path = tmp_path_factory.mktemp("template") / "small.cfg"
    body = "".join(LAYER.format(*pair) for pair in [(16, 2), (32, 2), (48, 2), (64, 1), (64, 2)])
    path.write_text(SMALL.format(body=body))
    return path


TRANSFORMER = {
    "model_type": "rt_detr",
    "backbone_config": {
        "model_type": "rt_detr_resnet",
        "embedding_size": 8,
        "hidden_sizes": [8, 16, 24, 32],
        "depths": [1, 1, 1, 1],
        "layer_type": "basic",
        "out_indices": [2, 3, 4],
    },
    "freeze_backbone_batch_norms": False,
    "encoder_in_channels": [16, 24, 32],
    "encoder_hidden_dim": 16,
    "encoder_ffn_dim": 32,
    "encoder_attention_heads": 2,
    "d_model": 16,
    "decoder_in_channels": [16, 16, 16],
    "decoder_ffn_dim": 32,
    "decoder_attention_heads": 2,
    "decoder_layers": 2,
    "num_queries": 8,
    "num_denoising": 8,
}


@pytest.fixture(scope="module", params=["anchor-free", "transformer"])
def other_template(request, template, tmp_path_factory):
    """The other kinds that can be trained, as small as the first."""
    folder = tmp_path_factory.mktemp("others")
    if request.param == "anchor-free":
        text = template.read_text().replace("filters=12\n", "filters=5\n")
        path = folder / "free.cfg"
        path.write_text(text[: text.index("[yolo]")] + "[anchor_free]\nclasses=1\n")
        return path
    path = folder / "transformer"
    path.mkdir()
    (path / "config.json").write_text(json.dumps(TRANSFORMER))
    preparation = {"do_normalize": False, "size": {"height": 64, "width": 64}}
    (path / "preprocessor_config.json").write_text(json.dumps(preparation))
    return path


@pytest.fixture(autouse=True)
def one_thread():
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture(scope="module")
def trained(shapes, template, tmp_path_factory):
    out = tmp_path_factory.mktemp("trained")
    train_detector(shapes, out, SETTINGS, template=template)
    return out


class TestTraining:
    def test_learns(self, trained, shapes, template):
        report = json.loads((trained / "small.json").read_text())["test"]
        assert set(report) == {"all", "bright", "dark", "empty"}
        assert report["all"]["ap50"] > 0.6
        network = Darknet(read_config(trained / template.name))
        untrained = DarknetDetector(network, ["rectangle"], "untrained")
        assert measure(untrained, LabelledPictures(shapes))["all"]["ap50"] < 0.1

    def test_result_is_an_ordinary_detector(self, trained, shapes):
        detector = load_detector(str(trained / "small.cfg"))
        assert detector.class_names == ("rectangle",)
        report = json.loads((trained / "small.json").read_text())["test"]
        assert measure(detector, LabelledPictures(shapes)) == report

    def test_finished_training_is_not_overwritten(self, trained, shapes, template):
        with pytest.raises(RunError, match="already holds a training; add --resume"):
            train_detector(shapes, trained, SETTINGS, template=template)

    def test_resuming_with_other_settings(self, trained, shapes, template):
        other = Settings(epochs=11, batch=16, seed=1)
        with pytest.raises(RunError, match="was trained with seed=0"):
            train_detector(shapes, trained, other, template=template, resume=True)


@pytest.fixture
def interrupted(monkeypatch):
    """Trains, and is interrupted in the middle of the second epoch."""

    def train(*arguments, **options):
        honest = DetectorTask.batch

        def breaks(self, step, rng):
            if self.where(step) == "epoch 2, batch 3":
                raise KeyboardInterrupt
            return honest(self, step, rng)

        monkeypatch.setattr(DetectorTask, "batch", breaks)
        with pytest.raises(KeyboardInterrupt):
            train_detector(*arguments, **options)
        monkeypatch.setattr(DetectorTask, "batch", honest)

    return train


def test_interrupted_training_ends_like_an_uninterrupted_one(
    shapes, template, tmp_path, interrupted
):
    settings = Settings(epochs=2, batch=16)
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    train_detector(shapes, whole, settings, template=template)
    interrupted(shapes, parts, settings, template=template)
    assert not (parts / "small.safetensors").exists()
    train_detector(shapes, parts, settings, template=template, resume=True)
    assert (whole / "small.safetensors").read_bytes() == (parts / "small.safetensors").read_bytes()


class TestOtherKinds:
    """Anchor-free networks and transformers go through the same loop (see test_builtin.py)."""

    def test_saved_is_what_was_trained(self, shapes, other_template, tmp_path):
        settings = Settings(epochs=1, batch=16)
        report = train_detector(shapes, tmp_path, settings, template=other_template)
        is_file = other_template.suffix == ".cfg"
        detector = load_detector(str(tmp_path / other_template.name if is_file else tmp_path))
        assert detector.class_names == ("rectangle",)
        assert detector.differentiable
        assert measure(detector, LabelledPictures(shapes)) == report.test
        assert json.loads((tmp_path / f"{other_template.stem}.json").read_text()) == as_json(report)

    def test_interrupted_training(self, shapes, other_template, tmp_path, interrupted):
        settings = Settings(epochs=2, batch=16)
        results = []
        for name, stops in (("whole", False), ("parts", True)):
            out = tmp_path / name
            if stops:
                interrupted(shapes, out, settings, template=other_template)
            train_detector(shapes, out, settings, template=other_template, resume=stops)
            results.append(next(out.glob("*.safetensors")).read_bytes())
        assert results[0] == results[1]

    def test_fine_tuning_begins_with_the_weights(self, shapes, other_template, tmp_path):
        data, images = LabelledPictures(shapes), torch.rand(2, 3, 64, 64)
        first = start(data, other_template, tmp_path / "first", Settings(seed=1))
        saved = first.save(first.network)
        second = start(data, saved, tmp_path / "second", Settings(fine_tune=True))
        again = load_detector(str(second.save(second.network))).candidates(images)
        expected = load_detector(str(saved)).candidates(images)
        torch.testing.assert_close(again.boxes, expected.boxes)
        torch.testing.assert_close(again.class_scores, expected.class_scores)


class TestLoss:
    def test_ciou_by_hand(self):
        """Equal squares, shifted by half: IoU 1/3, centre distance² 25, diagonal² 15² + 10²."""
        first = torch.tensor([0.0, 0.0, 10.0, 10.0])
        second = torch.tensor([5.0, 0.0, 15.0, 10.0])
        assert ciou(first, second).item() == pytest.approx(1 / 3 - 25 / 325, rel=1e-5)
        assert ciou(first, first).item() == pytest.approx(1)

    @pytest.mark.parametrize("box", [[5.0, 5, 5, 5], [50.0, 50, 60, 60], [9.0, 9, 2, 2]])
    def test_ciou_gradient_is_finite(self, box):
        moving = torch.tensor(box, requires_grad=True)
        ciou(moving, torch.tensor([0.0, 0.0, 10.0, 10.0])).backward()
        assert moving.grad.isfinite().all()

    @pytest.mark.parametrize("count", [0, 3])
    def test_descends_to_the_objects(self, template, count):
        """Raw outputs alone, optimised freely, end at the targets and nowhere else."""
        network = Darknet(read_config(template))
        centres = torch.tensor([[10.0, 12, 9, 11], [40, 30, 22, 18], [50, 55, 12, 9]])[:count]
        boxes = cxcywh_to_xyxy(centres)
        labels = torch.zeros(count, dtype=torch.long)
        targets = Targets(boxes, labels, torch.arange(count) % 2)
        raw = torch.zeros(2, 12, 4, 4, requires_grad=True)
        optimizer = torch.optim.Adam([raw], 0.1)
        for _ in range(300):
            loss = torch.stack(list(yolo_loss(network.heads, [raw], targets, (64, 64)).values()))
            optimizer.zero_grad()
            loss.sum().backward()
            optimizer.step()
        found = network.heads[0].candidates(raw.detach(), (64, 64))
        sure = found.objectness > 0.9
        assert sure.any(dim=1).tolist() == [count > 0, count > 1]
        for image in range(2):
            for box in found.boxes[image][sure[image]]:
                nearest = (boxes[targets.images == image] - box).abs().amax(dim=1).min()
                assert nearest < 0.5


class TestAugmentation:
    def test_boxes_follow_the_picture(self):
        """A white patch stays inside its box and fills it."""
        for seed in range(30):
            picture = np.full((80, 100, 3), 40, np.uint8)
            picture[20:50, 30:80] = 255
            labels = np.array([[30.0, 20.0, 80.0, 50.0, 1.0]])
            random = np.random.default_rng(seed)
            changed, moved = augment(picture, labels, (64, 64), random)
            assert changed.shape == (64, 64, 3)
            if not len(moved):
                continue
            left, top, right, bottom, label = moved[0].round().astype(int)
            assert label == 1
            grey = changed.astype(float).mean(axis=2)
            inside = grey[top + 2 : bottom - 2, left + 2 : right - 2]
            assert inside.min() > grey[0, 0] + 20 or inside.size == 0

    def test_same_seed_same_picture(self):
        picture = np.random.default_rng(0).integers(0, 256, (80, 100, 3), np.uint8)
        results = [
            augment(picture, np.zeros((0, 5)), (64, 64), np.random.default_rng(seed))[0]
            for seed in (5, 5, 6)
        ]
        assert np.array_equal(results[0], results[1])
        assert not np.array_equal(results[0], results[2])


class TestAnchors:
    def test_finds_clusters(self):
        generator = torch.Generator().manual_seed(0)
        centres = torch.tensor([[10.0, 20.0], [40.0, 30.0], [90.0, 60.0]])
        noise = torch.randn(300, 2, generator=generator)
        sizes = centres.repeat(100, 1) + noise
        anchors = cluster_anchors(sizes, 3, generator)
        assert (anchors - centres).abs().max() < 1

    def test_fewer_boxes_than_anchors(self):
        sizes = torch.tensor([[10.0, 20.0]])
        assert cluster_anchors(sizes, 3, torch.Generator()).tolist() == [[10, 20]] * 3

    def test_written_into_all_heads(self):
        text = write_anchors("a\nanchors = 1,2\nb\nanchors=3,4\n", torch.tensor([[5.0, 6.4]]))
        assert text == "a\nanchors=5,6\nb\nanchors=5,6\n"


class TestDataset:
    @pytest.mark.parametrize(
        ("change", "message"),
        [
            (lambda t: t.pop("split"), "key 'split' is missing"),
            (lambda t: t["group"].pop(), r"'group' has 11 entries, images.npy holds 12"),
            (
                lambda t: t["boxes"][0].append([0, 0, 65, 9, 0]),
                r"boxes of picture 0 must lie in 64",
            ),
            (lambda t: t["boxes"][1].append([0, 0, 9, 9, 1]), r"boxes of picture 1 .* known class"),
            (lambda t: t["boxes"][1].append([9, 0, 9, 9, 0]), r"boxes of picture 1"),
        ],
    )
    def test_wrong_labels(self, tmp_path, change, message):
        folder = write_shapes(tmp_path, 12)
        table = json.loads((folder / "labels.json").read_text())
        change(table)
        (folder / "labels.json").write_text(json.dumps(table))
        with pytest.raises(DetectorError, match=message):
            LabelledPictures(folder)

    def test_missing_or_wrong_pictures(self, tmp_path):
        with pytest.raises(DetectorError, match="no data set for a detector"):
            LabelledPictures(tmp_path)
        np.save(write_shapes(tmp_path, 12) / "images.npy", np.zeros((12, 8, 8)))
        with pytest.raises(DetectorError, match=r"is float64 \(12, 8, 8\), must be uint8"):
            LabelledPictures(tmp_path)

    def test_too_few_pictures(self, tmp_path, template):
        folder = write_shapes(tmp_path / "few", 12)
        with pytest.raises(DetectorError, match="9 pictures to train on, too few"):
            train_detector(folder, tmp_path / "out", Settings(epochs=1), template=template)
