"""The configurations that we write ourselves are those of the published weights."""

from pathlib import Path

import numpy as np
import pytest
import torch

from cnca.core.errors import DetectorError
from cnca.detect import load_detector
from cnca.detect.cfg import parse_config
from cnca.detect.darknet import Convolution, Darknet
from cnca.detect.weights import load_weights
from cnca.detect.yolov3 import CONFIGS, yolov3, yolov3_tiny
from tests.detect import reference
from tests.detect.test_detectors import DetectorContract

HEADER = np.array([0, 2, 0, 0, 0], "<i4").tobytes()
COUNTS = {"yolov3": 62_001_757, "yolov3-tiny": 8_858_734}
"""The published files hold so many numbers after 20 bytes of header."""


def write_weights(folder, name, network):
    """Darknet's file of a network, written here a second time."""
    path = folder / f"{name}.weights"
    with path.open("wb") as file:
        file.write(HEADER)
        for layer in network.layers:
            if not isinstance(layer, Convolution):
                continue
            norm, kernel = layer.norm, layer.convolution
            first = [kernel.bias]
            if norm is not None:
                first = [norm.bias, norm.weight, norm.running_mean, norm.running_var]
            for tensor in [*first, kernel.weight]:
                file.write(tensor.detach().numpy().astype("<f4").tobytes())
    return path


def write_zeros(folder, name, surplus=0):
    """A file of the published length or nearly so that takes no place on the disk."""
    path = folder / f"{name}.weights"
    with path.open("wb") as file:
        file.write(HEADER)
        file.truncate(len(HEADER) + 4 * (COUNTS[name] + surplus))
    return path


@pytest.fixture(scope="module", params=[(yolov3, "yolov3"), (yolov3_tiny, "yolov3-tiny")])
def small(request, tmp_path_factory):
    """Both networks at 64 × 64 pixels: configuration and weights on disk."""
    make, name = request.param
    folder = tmp_path_factory.mktemp(name)
    config = folder / f"{name}.cfg"
    config.write_text(make(size=64))
    network = Darknet(parse_config(config.read_text(), config))
    write_weights(folder, name, network)
    return config


class TestYolov3Tiny(DetectorContract):
    @pytest.fixture(scope="class")
    def detector(self, tmp_path_factory):
        config = tmp_path_factory.mktemp("contract") / "yolov3-tiny.cfg"
        config.write_text(yolov3_tiny(size=64))
        write_weights(config.parent, config.stem, Darknet(parse_config(config.read_text(), config)))
        return load_detector(str(config))


def test_weights_alone(tmp_path):
    """The configuration is ours where none lies beside the weights."""
    detector = load_detector(str(write_zeros(tmp_path, "yolov3-tiny")))
    assert (detector.name, detector.size) == ("yolov3-tiny", (416, 416))
    assert detector.class_names[2] == "car"


def test_weights_of_the_published_length(small):
    """They load and give what a second implementation gives; the gradient reaches every pixel."""
    weights = small.with_suffix(".weights")
    assert weights.stat().st_size == 20 + 4 * COUNTS[small.stem]
    network = Darknet(parse_config(small.read_text(), small)).eval().requires_grad_(False)
    load_weights(network, weights)
    image = torch.rand(1, 3, 64, 64, generator=torch.Generator().manual_seed(0)).requires_grad_()
    heads = network(image)
    expected = reference.run(small, weights, image[0].detach().double().numpy())
    assert len(heads) == len(expected)
    for head, values in zip(heads, expected, strict=True):
        found = head[0].detach().double().numpy()
        # Single precision through up to 75 layers: relative to the largest output.
        assert np.abs(found - values).max() < 1e-4 * np.abs(values).max()
    torch.stack([head.square().mean() for head in heads]).sum().backward()
    assert image.grad.isfinite().all()
    assert (image.grad != 0).all()


@pytest.mark.parametrize("surplus", [-1, 1])
def test_weights_of_another_length(tmp_path, surplus):
    path = write_zeros(tmp_path, "yolov3-tiny", surplus)
    count = COUNTS["yolov3-tiny"]
    with pytest.raises(DetectorError, match=f"needs {count} .*holds {count + surplus};") as caught:
        load_detector(str(path))
    assert "\n" not in str(caught.value)


def test_scales_and_anchors():
    """Section 2.3 of the paper: three scales with strides 32, 16, 8, the coarsest first."""
    network = Darknet(parse_config(yolov3(), Path("yolov3.cfg"))).eval()
    with torch.no_grad():
        shapes = [tuple(head.shape[1:]) for head in network(torch.zeros(1, 3, 64, 64))]
    assert shapes == [(255, 2, 2), (255, 4, 4), (255, 8, 8)]
    assert [head.anchors[0] for head in network.heads] == [(116, 90), (30, 61), (10, 13)]
    assert sum(isinstance(layer, Convolution) for layer in network.layers) == 75


@pytest.mark.parametrize("name", CONFIGS)
def test_other_classes(name):
    make = {"yolov3": yolov3, "yolov3-tiny": yolov3_tiny}[name]
    network = Darknet(parse_config(make(classes=1, size=96), Path(name))).eval()
    assert all(head.shape[1] == 18 for head in network(torch.rand(1, 3, 96, 96)))
