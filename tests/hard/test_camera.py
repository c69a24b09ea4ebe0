"""Cameras in the wrong place: inside, below, too near, too far, too wide."""

from __future__ import annotations

import numpy as np
import pytest

from tests.hard.looks import DIFFERENT, largest_z, look


@pytest.mark.parametrize("name", ["camera_inside_glass", "camera_under_ground"])
def test_where_no_light_comes_in_the_picture_is_black(name):
    assert (look(name).images == 0).all()
    assert (look(name).gradients == 0).all()


def test_from_under_foggy_ground_no_paint_is_seen():
    assert look("camera_under_ground_in_fog").contrast == 0
    assert (look("camera_under_ground_in_fog").gradients == 0).all()


@pytest.mark.parametrize("name", ["camera_touching_paint", "camera_telescope"])
def test_a_wall_is_as_bright_from_near_as_from_far(name):
    first, second = np.moveaxis(look(name).images, 1, 0)
    assert largest_z(first.mean(axis=(2, 3)), second.mean(axis=(2, 3))) < DIFFERENT


def test_straight_down_left_and_right_of_the_sun_look_the_same():
    """The picture's upper end is the vehicle's front, and the sun stands over it."""
    first, second = (
        look("camera_straight_down").images[0::2],
        look("camera_straight_down").images[1::2],
    )
    assert largest_z(first, second[..., ::-1]) < DIFFERENT
    assert largest_z(first, second[..., ::-1, :]) > DIFFERENT
