"""Detectors of torchvision where it is there, and a clear message where it is not."""

import importlib.util

import pytest
import torch

from cnca.core.errors import DetectorError
from cnca.detect import load_detector
from tests.detect.test_detectors import DetectorContract

MODELS = ("fasterrcnn_mobilenet_v3_large_320_fpn", "retinanet_resnet50_fpn", "fcos_resnet50_fpn")
MODELS += ("ssdlite320_mobilenet_v3_large",)


def test_missing_package(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(DetectorError, match="needs the package torchvision") as caught:
        load_detector("torchvision:fcos_resnet50_fpn:weights.pth")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("spec", ["torchvision:", "torchvision:fcos:", "torchvision::a.pth"])
def test_incomplete(spec):
    with pytest.raises(DetectorError, match="write torchvision:NAME:FILE"):
        load_detector(spec)


class TestModels(DetectorContract):
    @pytest.fixture(scope="class", params=MODELS)
    @classmethod
    def loaded(cls, request, tmp_path_factory):
        """Random weights, three classes, and small inputs."""
        pytest.importorskip("torchvision", reason="torchvision is not installed")
        from torchvision.models import get_model

        torch.manual_seed(0)
        folder = tmp_path_factory.mktemp(request.param)
        model = get_model(request.param, weights=None, weights_backbone=None, num_classes=3)
        for name, values in model.named_parameters():
            if name.endswith("cls_logits.weight"):  # or nearly all scores tie
                values.data *= 30
        torch.save(model.state_dict(), folder / "random.pth")
        (folder / "random.names").write_text("background\nperson\ncar\n")
        detector = load_detector(f"torchvision:{request.param}:{folder / 'random.pth'}")
        detector.model.transform.min_size, detector.model.transform.max_size = (64,), 128
        detector.model.transform.fixed_size = None
        return detector

    @pytest.fixture
    def detector(self, loaded):
        return loaded

    def test_classes(self, detector):
        assert detector.class_names == ("background", "person", "car")

    def test_unsuppressed(self, detector):
        """More than one box on the same place."""
        found = detector.candidates(torch.rand(1, 3, 64, 64))
        assert (found.class_scores.sum(dim=2) > 0).sum() > 20


class TestUnusable:
    @pytest.fixture(autouse=True)
    def _needs_torchvision(self):
        pytest.importorskip("torchvision", reason="torchvision is not installed")

    def test_unknown_name(self):
        with pytest.raises(DetectorError, match="fcos_resnet5_fpn: unknown; .*'fcos_resnet50_fpn'"):
            load_detector("torchvision:fcos_resnet5_fpn:a.pth")

    @pytest.mark.parametrize("name", ["none.pth", "noise.pth", "noise.safetensors", "other.pth"])
    def test_unusable_weights(self, tmp_path, name):
        path = tmp_path / name
        if name.startswith("noise"):
            path.write_bytes(b"noise")
        elif name.startswith("other"):
            torch.save({"a": torch.zeros(1)}, path)
        with pytest.raises(DetectorError, match=name) as caught:
            load_detector(f"torchvision:ssdlite320_mobilenet_v3_large:{path}")
        assert "\n" not in str(caught.value)
