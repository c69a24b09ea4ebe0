"""Detectors as a whole: one contract for all, and cars found in real frames."""

import subprocess
import sys

import pytest
import torch

from cnca.core.detections import suppress
from cnca.core.errors import DetectorError, NonFiniteError
from cnca.detect import BUILTINS, load_detector
from cnca.detect.preprocess import letterbox, stretch
from cnca.scene.protocols import Detector
from cnca.train.detector.obstacles import CLASSES

# The vehicle's box in the frames, read off by eye to about 15 pixels.
CAR_IN_STREET = torch.tensor([185.0, 312.0, 600.0, 500.0])


class DetectorContract:
    """What every detector must do; subclasses give ``detector``."""

    def test_is_a_detector(self, detector):
        assert isinstance(detector, Detector)
        assert detector.name
        assert "car" in detector.class_names

    def test_shapes_and_ranges(self, detector):
        found = detector.candidates(torch.rand(2, 3, 90, 130))
        count = found.boxes.shape[1]
        assert found.boxes.shape == (2, count, 4)
        assert found.objectness.shape == (2, count)
        assert found.class_scores.shape == (2, count, len(detector.class_names))
        for scores in (found.objectness, found.class_scores):
            assert 0 <= scores.min() <= scores.max() <= 1

    def test_images_do_not_see_each_other(self, detector):
        images = torch.rand(3, 3, 64, 64, generator=torch.Generator().manual_seed(0))
        together, alone = detector.candidates(images), detector.candidates(images[1:2])
        torch.testing.assert_close(together.boxes[1], alone.boxes[0], rtol=1e-3, atol=1e-2)
        torch.testing.assert_close(together.objectness[1], alone.objectness[0])
        torch.testing.assert_close(together.class_scores[1], alone.class_scores[0])

    def test_gradient_as_promised(self, detector):
        images = torch.rand(1, 3, 96, 96).requires_grad_()
        found = detector.candidates(images)
        scores = found.objectness[..., None] * found.class_scores
        assert scores.requires_grad == found.boxes.requires_grad == detector.differentiable
        if detector.differentiable:
            scores.sum().backward()
            assert images.grad.isfinite().all()
            assert (images.grad != 0).float().mean() > 0.9

    def test_double_precision_is_accepted(self, detector):
        images = torch.rand(1, 3, 64, 64)
        single, double = detector.candidates(images), detector.candidates(images.double())
        torch.testing.assert_close(single.objectness.double(), double.objectness.double())

    def test_detections_are_sorted_and_inside(self, detector):
        images = torch.rand(2, 3, 96, 128)
        for found in detector.detect(images, score_threshold=0.001):
            assert (found.scores.diff() <= 0).all()
            assert (found.boxes >= 0).all()
            assert (found.boxes <= torch.tensor([128, 96, 128, 96])).all()

    def test_non_finite_pictures_are_named(self, detector):
        images = torch.rand(2, 3, 64, 64)
        images[1] = torch.nan
        with pytest.raises(NonFiniteError, match="image 1"):
            detector.detect(images)


class TestTiny(DetectorContract):
    @pytest.fixture
    def detector(self, tiny):
        return load_detector(str(tiny))


class TestBuiltin(DetectorContract):
    """All that ship."""

    @pytest.fixture(params=BUILTINS)
    def detector(self, request):
        return load_detector(request.param)

    def test_knows_cars_first(self, detector):
        assert detector.class_names == CLASSES[: len(detector.class_names)]
        assert detector.class_names[0] == "car"


class TestYoloFastest(DetectorContract):
    @pytest.fixture
    def detector(self, detectors):
        return load_detector(str(detectors / "yolo-fastest-1.1-xl.cfg"))

    def test_finds_the_car(self, detector, street):
        assert_finds_car(detector, street)


class TestYolox(DetectorContract):
    @pytest.fixture
    def detector(self, detectors):
        return load_detector(str(detectors / "yolox_nano.onnx"))

    def test_finds_the_car(self, detector, street):
        assert_finds_car(detector, street)


class TestFastestDet(DetectorContract):
    @pytest.fixture
    def detector(self, detectors):
        return load_detector(str(detectors / "fastestdet.onnx"))

    def test_finds_the_car(self, detector, street):
        found = detector.detect(street)[0]
        cars = found.of(detector.class_names.index("car"))
        assert (cars.boxes[0] - CAR_IN_STREET).abs().max() < 75


def assert_finds_car(detector, street):
    best = detector.detect(street)[0]
    assert detector.class_names[int(best.labels[0])] == "car"
    assert best.scores[0] > 0.8
    assert (best.boxes[0] - CAR_IN_STREET).abs().max() < 75


@pytest.mark.parametrize("fit", [stretch, lambda *a: letterbox(*a, 0.5, centred=True)])
def test_boxes_come_back(fit):
    """A white patch is found where it was, whatever the picture's shape."""
    images = torch.zeros(1, 3, 60, 120)
    images[..., 20:40, 30:90] = 1
    inputs, placement = fit(images, (64, 64))
    rows, columns = torch.nonzero(inputs[0, 0] > 0.75, as_tuple=True)
    box = torch.stack([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]).float()
    expected = torch.tensor([30.0, 20.0, 90.0, 40.0])
    assert inputs.shape == (1, 3, 64, 64)
    assert (placement.back(box) - expected).abs().max() <= 2


def test_letterbox_fills_with_grey():
    inputs, _ = letterbox(torch.zeros(1, 3, 20, 40), (40, 40), 0.5, centred=True)
    assert (inputs[0, 0, :, 0] == 0.5).float().mean() == 0.5
    assert inputs[0, 0, 19:21].max() == 0


def test_suppression_within_classes_only():
    boxes = torch.tensor([[0.0, 0, 10, 10], [0.0, 0, 10, 9], [0.0, 0, 10, 4]])
    scores = torch.tensor([[0.6, 0.0], [0.9, 0.0], [0.7, 0.8]])
    found = suppress(boxes, scores, score_threshold=0.5, iou_threshold=0.45)
    assert found.scores.tolist() == pytest.approx([0.9, 0.8, 0.7])
    assert found.labels.tolist() == [0, 1, 0]
    nothing = suppress(boxes, scores, score_threshold=0.95, iou_threshold=0.45)
    assert nothing.boxes.shape == (0, 4)


class TestSpecifications:
    @pytest.mark.parametrize(
        ("spec", "message"),
        [
            ("buildin", r"'buildin': unknown; .*did you mean 'builtin'"),
            ("nowhere.cfg", r"nowhere\.cfg: cannot be read"),
            ("yolov3-tyny.weights", r"no yolov3-tyny\.cfg beside it; .*'yolov3-tiny'"),
            ("yolov3.weights", r"yolov3\.weights: weights cannot be read"),
            ("nowhere.onnx", r"nowhere\.onnx: no such file"),
        ],
    )
    def test_unknown(self, spec, message):
        with pytest.raises(DetectorError, match=message):
            load_detector(spec)

    def test_no_weights(self, tiny):
        tiny.with_suffix(".weights").unlink()
        with pytest.raises(DetectorError, match=r"put tiny\.safetensors or tiny\.weights"):
            load_detector(str(tiny))

    def test_names_missing_or_too_few(self, tiny):
        tiny.with_suffix(".names").write_text("car\n")
        with pytest.raises(DetectorError, match="1 names for 2 classes"):
            load_detector(str(tiny))
        tiny.with_suffix(".names").unlink()
        with pytest.raises(DetectorError, match=r"names of its 2 classes to tiny\.names"):
            load_detector(str(tiny))

    def test_no_onnx_model(self, tmp_path):
        (tmp_path / "noise.onnx").write_bytes(b"noise")
        with pytest.raises(DetectorError, match=r"noise\.onnx: ONNX Runtime cannot open it"):
            load_detector(str(tmp_path / "noise.onnx"))

    def test_importing_is_light(self):
        code = (
            "import sys, cnca.detect;"
            "print([name for name in ('torch', 'onnxruntime', 'cv2') if name in sys.modules])"
        )
        python = [sys.executable, "-c", code]
        run = subprocess.run(python, capture_output=True, text=True, check=True)
        assert run.stdout.strip() == "[]"
