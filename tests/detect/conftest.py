"""Small Darknet networks with random weights, and the real files where they are at hand."""

from pathlib import Path

import numpy as np
import pytest
import torch

SHARED = (Path(__file__).parents[2] / "../shared").resolve()

TINY = """
[net]
width=32
height=32
channels=3
[convolutional]
batch_normalize=1
filters=6
size=3
stride=1
pad=1
activation=leaky
[maxpool]
size=2
stride=2
[convolutional]
batch_normalize=1
filters=8
size=3
stride=2
pad=1
groups=2
activation=mish
[maxpool]
size=2
stride=1
[maxpool]
size=5
stride=1
[dropout]
probability=.5
[convolutional]
filters=8
size=1
stride=1
pad=0
activation=linear
[shortcut]
from=-4
activation=relu
[route]
layers=-1,2
[convolutional]
filters=14
size=1
stride=1
activation=linear
[yolo]
mask=1,2
anchors=4,5, 8,6, 14,20
classes=2
num=3
scale_x_y=1.1
[route]
layers=-4
groups=2
group_id=1
[upsample]
stride=2
[route]
layers=-1,1
[convolutional]
filters=7
size=3
pad=1
activation=linear
[yolo]
mask=0
anchors=4,5, 8,6, 14,20
classes=2
num=3
"""
CONVOLUTIONS = ((6, 27, True), (8, 27, True), (8, 8, False), (14, 16, False), (7, 90, False))
"""Filters, inputs to each and batch normalisation of TINY's convolutions, counted by hand."""
WEIGHT_COUNT = sum(f * (n + (4 if norm else 1)) for f, n, norm in CONVOLUTIONS)


def write_weights(path, seed=0):
    """Darknet's header, then random statistics (variances positive) and kernels."""
    random = np.random.default_rng(seed)
    parts = []
    for filters, inputs, normalised in CONVOLUTIONS:
        parts.append(random.normal(0, 0.3, filters))  # biases
        if normalised:
            parts += [random.uniform(0.5, 1.5, filters), random.normal(0, 0.3, filters)]
            parts.append(random.uniform(0.2, 2, filters))
        parts.append(random.normal(0, inputs**-0.5, filters * inputs))
    header = np.array([0, 2, 5, 0, 0], "<i4").tobytes()
    path.write_bytes(header + np.concatenate(parts).astype("<f4").tobytes())


@pytest.fixture
def tiny(tmp_path):
    """Path of TINY's configuration with weights and names beside it."""
    config = tmp_path / "tiny.cfg"
    config.write_text(TINY)
    write_weights(tmp_path / "tiny.weights")
    (tmp_path / "tiny.names").write_text("car\ntruck\n")
    return config


@pytest.fixture
def detectors():
    """Folder of the real detectors."""
    if not (SHARED / "detectors").is_dir():
        pytest.skip("needs the detectors beside the project (../shared/detectors)")
    return SHARED / "detectors"


@pytest.fixture(params=["data1", "data12505", "data12509"])
def street(request):
    """A photograph-like frame with one car in the middle, (1, 3, 800, 800), sRGB in [0, 1]."""
    path = SHARED / "data" / "carla" / f"{request.param}.npz"
    if not path.is_file():
        pytest.skip("needs the CARLA frames beside the project (../shared/data/carla)")
    rgb = np.load(path)["img"][..., ::-1].copy()
    return torch.from_numpy(rgb).permute(2, 0, 1)[None].float() / 255
