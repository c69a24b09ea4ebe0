"""What comes after the picture: display encoding, detector, loss and scores at their edges."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from cnca.attack.detection_scores import best_scores
from cnca.attack.objectives import logit, odds, paper
from cnca.core.color import linear_to_srgb
from cnca.core.errors import SceneError
from cnca.core.types import Candidates, Detections
from cnca.detect import load_detector
from cnca.judge.scores import detection_score
from cnca.scene.paint import Paint
from cnca.scene.protocols import Detector
from tests.hard.looks import Stage, look

BOX = torch.tensor([4.0, 4.0, 20.0, 20.0])
EPSILON = torch.finfo(torch.float32).eps


@pytest.fixture(scope="module")
def detector() -> Detector:
    return load_detector("builtin")


@pytest.mark.parametrize("radiance", [0.0, 1e6], ids=["black", "sun-bright"])
def test_a_picture_without_contrast_goes_through_detector_and_loss(detector, radiance):
    """Nothing is found in it, the loss is that of no vehicle, and the gradient is finite."""
    image = torch.full((1, 3, 24, 24), radiance, requires_grad=True)
    seen = detector.candidates(linear_to_srgb(image))
    loss, score = paper.Loss()(seen, BOX[None], 0), float(best_scores(seen, BOX[None], 0).detach())
    loss.backward()
    assert 0 <= score < 0.5
    assert float(loss.detach()) == pytest.approx(-math.log(1 - score), rel=1e-4)
    assert torch.isfinite(image.grad).all()
    if radiance > 0:
        assert (image.grad == 0).all()  # beyond white nothing changes on the display
    found = detector.detect(linear_to_srgb(image.detach()), score_threshold=0.5)[0]
    assert detection_score(found, BOX, 0) == 0


def test_the_black_frame_of_a_night_has_a_gradient_of_exactly_zero():
    stage = Stage("light_none")
    texture = stage.texture.clone().requires_grad_()
    picture = linear_to_srgb(stage.images(texture))
    picture.mean().backward()
    assert (picture == 0).all()
    assert (texture.grad == 0).all()


def test_a_sun_bright_pixel_is_white_and_leaves_its_neighbours_alone():
    image = torch.from_numpy(look("plain").image.copy())
    bright = image.clone()
    bright[0, :, 3, 4] = 1e6
    difference = linear_to_srgb(bright) - linear_to_srgb(image)
    assert (1 - linear_to_srgb(bright)[0, :, 3, 4]).abs().max() <= EPSILON
    difference[0, :, 3, 4] = 0
    assert (difference == 0).all()


def test_the_display_curve_starts_with_its_straight_piece():
    """IEC 61966-2-1: slope 12.92 at 0, where the power alone would be infinitely steep."""
    zero = torch.zeros(1, requires_grad=True)
    encoded = linear_to_srgb(zero)
    encoded.backward()
    assert (encoded == 0).all()
    assert float(zero.grad) == pytest.approx(12.92)


def candidates(score: float, count: int = 1) -> Candidates:
    boxes = BOX.expand(1, count, 4)
    objectness = torch.full((1, count), score, requires_grad=True)
    return Candidates(boxes, objectness, torch.ones(1, count, 1))


def test_a_score_of_exactly_one_costs_a_finite_loss_with_a_slope():
    """L = −log(1 − D (1 − ε)) at D = 1: −log ε, slope (1 − ε)/ε."""
    certain = candidates(1.0)
    loss = paper.Loss()(certain, BOX[None], 0)
    loss.backward()
    assert (best_scores(certain, BOX[None], 0) == 1).all()
    assert float(loss.detach()) == pytest.approx(-math.log(EPSILON), rel=1e-6)
    assert float(certain.objectness.grad) == pytest.approx((1 - EPSILON) / EPSILON, rel=1e-6)


def test_no_detection_scores_and_costs_nothing():
    nothing = candidates(0.0, count=0)
    loss = paper.Loss()(nothing, BOX[None], 0)
    loss.backward()
    none = Detections(torch.zeros(0, 4), torch.zeros(0), torch.zeros(0, dtype=torch.long))
    assert loss == 0
    assert (best_scores(nothing, BOX[None], 0) == 0).all()
    assert logit.Loss()(nothing, BOX[None], 0).isfinite().all()
    assert odds.Loss()(nothing, BOX[None], 0) == 0
    assert detection_score(none, BOX, 0) == 0


def test_an_empty_paint_mask_leaves_the_texture_and_no_gradient():
    base = torch.rand(3, 8, 8, generator=torch.Generator().manual_seed(0))
    texture = torch.full((3, 5, 7), 0.5, requires_grad=True)
    empty = Paint(base, torch.zeros(1, 8, 8))
    empty.apply(texture).sum().backward()
    torch.testing.assert_close(empty.apply(texture), empty.apply())
    assert (texture.grad == 0).all()


@pytest.mark.parametrize("name", ["camera_under_ground", "camera_inside_glass"])
def test_a_camera_without_a_vehicle_in_sight_has_no_box(name):
    stage = Stage(name)
    with pytest.raises(SceneError, match="camera (below: does not see|driver: is inside)"):
        stage.renderer.vehicle_boxes(stage.views)


def test_the_smallest_vehicle_has_a_box_of_its_pixels():
    stage = Stage("mesh_one_pixel")
    left, top, right, bottom = stage.renderer.vehicle_boxes(stage.views)[0].tolist()
    rows, columns = np.nonzero(look("mesh_one_pixel").layers.mask[0])
    assert [left, top, right - 1, bottom - 1] == [
        columns.min(),
        rows.min(),
        columns.max(),
        rows.max(),
    ]
