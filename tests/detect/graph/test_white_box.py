"""ONNX files as white boxes: gradients, batches, weights among the inputs, suppression."""

import pytest
import torch

pytest.importorskip("onnx", reason="needs the package onnx to build graphs")

import onnx

from cnca.attack.targets import Target, refuse_black_boxes
from cnca.core.errors import DetectorError
from cnca.detect import load_detector
from cnca.detect.graph.check import NoGradientError, white_box
from tests.detect.graph.networks import write_network
from tests.detect.graphs import write_graph
from tests.detect.test_detectors import DetectorContract
from tests.detect.test_onnx import detections_arrays

CAR = 2


class TestWhiteBox(DetectorContract):
    @pytest.fixture(params=["plain", "two at a time", "weights as inputs", "suppression"])
    def detector(self, request, tmp_path):
        options = {
            "plain": {},
            "two at a time": {"batch": 2},
            "weights as inputs": {"weights_as_inputs": True},
            "suppression": {"suppression": True},
        }[request.param]
        return load_detector(str(write_network(tmp_path / "net.onnx", **options)))

    def test_has_a_gradient(self, detector):
        assert detector.differentiable


def car_score(detector, images):
    return detector.candidates(images).class_scores[..., CAR].double().sum()


def assert_gradient_is_right(detector, images, step):
    """Along the gradient, against ONNX Runtime, which knows nothing of torch's gradient."""
    images = images.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(car_score(detector, images), images)
    direction = gradient / gradient.norm()
    with torch.no_grad():
        ends = [car_score(detector, images + side * step * direction) for side in (1, -1)]
    found = ((ends[0] - ends[1]) / (2 * step)).item()
    assert found == pytest.approx(gradient.norm().item(), rel=0.02)


def test_gradient_against_finite_differences(tmp_path):
    images = torch.rand(1, 3, 64, 96, generator=torch.Generator().manual_seed(1))
    assert_gradient_is_right(load_detector(str(write_network(tmp_path / "n.onnx"))), images, 0.1)


def test_gradient_of_yolox_against_finite_differences(detectors, street):
    detector = load_detector(str(detectors / "yolox_nano.onnx"))
    assert_gradient_is_right(detector, street[..., 200:616, 150:650], 0.02)


def test_suppression_is_cut_off(tmp_path):
    """What is left are the candidates of the network without it."""
    plain = load_detector(str(write_network(tmp_path / "plain.onnx")))
    cut = load_detector(str(write_network(tmp_path / "cut.onnx", suppression=True)))
    images = torch.rand(1, 3, 64, 96)
    (tmp_path / "cut.yaml").write_text("white: 1\n")
    expected = plain.candidates(images)
    found = cut.candidates(images)
    assert found.boxes.shape == expected.boxes.shape
    assert found.class_scores.shape == expected.class_scores.shape


class TestReasons:
    """Why a file stays a black box."""

    def load(self, path):
        return load_detector(str(path))

    def test_constant_outputs(self, tmp_path):
        detector = self.load(write_graph(tmp_path / "net.onnx", detections_arrays()))
        assert not detector.differentiable
        with pytest.raises(DetectorError, match=r"gives no gradient \(its outputs do not follow"):
            refuse_black_boxes([Target("net.onnx", detector, CAR)])

    def test_unknown_operation(self, tmp_path):
        model = onnx.load(str(write_network(tmp_path / "net.onnx", unknown=True)))
        with pytest.raises(NoGradientError, match="operation SphericalConv is not supported"):
            white_box(model, {"image": torch.zeros(1, 3, 64, 96)}, "image", {})

    def test_other_numbers(self, tmp_path):
        model = onnx.load(str(write_network(tmp_path / "net.onnx")))
        inputs, wrong = {"image": torch.zeros(1, 3, 64, 96)}, torch.ones(1, 84, 126)
        with pytest.raises(NoGradientError, match=r"'output0' differs by 0\.5 between torch and"):
            white_box(model, inputs, "image", {"output0": wrong})
        with pytest.raises(NoGradientError, match=r"has shape \(1, 84, 126\) in torch, \(1, 84\)"):
            white_box(model, inputs, "image", {"output0": wrong[..., 0]})
