"""Boxes of things that are no vehicles."""

import numpy as np
import pytest

from cnca.scene.cameras import View
from cnca.train.detector.obstacles import LEAST_SIDE, OBSTACLE, obstacle_boxes
from cnca.vehicle.builtin import props

VIEW = View("ahead", (0.0, 0.0, 1.0), (10.0, 0.0, 1.0), (0.0, 0.0, 1.0), 60.0, 416, 256)
FOCAL = 416 / (2 * np.tan(np.radians(30)))


def block(x, y, side=1.0):
    """A cube on the ground around (x, y)."""
    return props.placed(props.box(np.full(3, side)), "paint", (x, y), 0.0)


def test_a_box_is_where_a_pinhole_sees_it():
    """The cube's near face, a metre high from the ground, 9.5 m ahead and 2 m to the left."""
    [[*box, label]] = obstacle_boxes([block(10, 2)], VIEW)
    near, far = 9.5, 10.5
    left, right = 208 - 2.5 / near * FOCAL, 208 - 1.5 / far * FOCAL
    top, bottom = 128.0, 128 + 1 / near * FOCAL
    assert label == OBSTACLE
    assert box == pytest.approx([left, top, right, bottom])


def test_what_is_hidden_small_or_beside_the_picture_is_left_out():
    near, behind, beside = block(8, 0), block(12, 0), block(6, 6)
    assert len(obstacle_boxes([near, behind], VIEW)) == 1
    assert len(obstacle_boxes([near, block(12, 3)], VIEW)) == 2
    assert obstacle_boxes([beside], VIEW) == []
    assert obstacle_boxes([block(0.2, 0)], VIEW) == []
    assert obstacle_boxes([near], VIEW, hidden_by=[(0, 0, 416, 256, 0)]) == []
    tiny = block(60, 0, side=0.9 * LEAST_SIDE * 60 / FOCAL)
    assert obstacle_boxes([tiny], VIEW) == []
    assert len(obstacle_boxes([block(60, 0, side=1.2 * LEAST_SIDE * 60 / FOCAL)], VIEW)) == 1


def test_boxes_end_at_the_picture():
    [[left, *_]] = obstacle_boxes([block(4, 2.0)], VIEW)
    assert left == 0.0
