"""Worlds that are mirrored, on their head or inside out, and lamps that light nothing."""

from __future__ import annotations

import numpy as np
import pytest

from cnca import build
from cnca.core.errors import SceneError
from tests.hard.looks import DIFFERENT, Stage, largest_z, load, look


def test_which_way_faces_are_wound_does_not_show():
    assert largest_z(look("world_inside_out").images, look("world_bare").images) < DIFFERENT


def test_a_mirrored_world_makes_the_mirrored_picture():
    flipped = look("world_mirrored").images[..., ::-1]
    assert largest_z(flipped, look("world_bare").images) < DIFFERENT


def test_what_lies_under_the_road_is_not_seen():
    """A world on its head is its road alone; a wall as wide as the sky is missing."""
    ground, above = (
        look(name).image[0, :, :3].mean() for name in ("world_upside_down", "world_bare")
    )
    assert np.isfinite(ground)
    assert ground > 1.05 * above  # the sky instead of the wall's shaded side


def test_a_lamp_that_is_walled_in_lights_nothing():
    lit = look("world_buried_lamp").image.mean()
    dark = Stage("world_buried_lamp")
    dark.weather = dark.weather.__class__(**{**vars(dark.weather), "lamps": "off"})
    assert lit == pytest.approx(float(dark.images().mean()), rel=0.1)


def test_a_vehicle_inside_a_wall_is_refused():
    scene = load("world_bare")
    world = scene.world.model_copy(update={"at": (0.0, 4.0)})
    moved = scene.model_copy(update={"world": world})
    with pytest.raises(
        SceneError, match="stands inside the vehicle at .0, 4.; move it by world.at"
    ):
        build.build_path_tracer(moved, build.build_vehicle(moved))
