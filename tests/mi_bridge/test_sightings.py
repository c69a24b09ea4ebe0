"""Labelled objects in pictures: where they are seen, and how much of them is hidden."""

import math

import numpy as np
import pytest

from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.scene.cameras import orbit_view
from cnca.vehicle.builtin.sedan import build_sedan
from cnca.world.model import Piece, Surface, World, WorldObject

SIDE, DISTANCE, BEHIND = 128, 12.0, 3.0
"""Pixels; metres from the camera to the vehicle's middle, and from there to the boards."""
FOCAL = SIDE / 2 / math.tan(math.radians(22.5))


def board(name, y, z, x=-BEHIND) -> Piece:
    """An upright rectangle that faces the camera on the +x axis; ranges in metres."""
    corners = [(x, y[0], z[0]), (x, y[1], z[0]), (x, y[1], z[1]), (x, y[0], z[1])]
    return Piece(
        name,
        "wood",
        np.array(corners, float),
        np.array([[0, 1, 2], [0, 2, 3]]),
        np.tile([1.0, 0.0, 0.0], (4, 1)),
    )


@pytest.fixture(scope="module")
def sightings():
    """Of a free board, one half of which a wall hides, one wholly hidden and one out of sight."""
    pieces = (
        board("free", (2.0, 4.0), (0.5, 1.5)),
        board("half", (-4.0, -2.0), (0.5, 1.5)),
        board("wall", (-3.0, -1.9), (0.0, 3.0), x=-BEHIND + 1e-2),
        board("hidden", (-2.8, -2.2), (0.6, 1.4), x=-BEHIND - 0.01),
        board("far", (50.0, 52.0), (0.5, 1.5)),
    )
    labels = {"free": "car", "half": "truck", "hidden": "bus", "far": "car"}
    objects = tuple(
        WorldObject(labels[piece.name], (i,))
        for i, piece in enumerate(pieces)
        if piece.name in labels
    )
    world = World("boards", pieces, {"wood": Surface()}, objects, ground=True)
    renderer = MitsubaRenderer(build_sedan(), texture_size=8, samples=1, worlds=lambda spot: world)
    view = orbit_view(
        0, 0.0, DISTANCE, fov=45, width=SIDE, height=SIDE, target=(0.0, 0.0, 1.0), name="front"
    )
    (seen,) = renderer.sightings([view])
    return {sighting.label: sighting for sighting in seen}


def columns(y):
    """Pin-hole camera: +y is to the right of one that looks along -x."""
    return [SIDE / 2 + FOCAL * value / (DISTANCE + BEHIND) for value in y]


def test_only_what_is_seen_is_listed(sightings):
    assert set(sightings) == {"car", "truck"}


def test_a_free_board_lies_where_the_pinhole_puts_it(sightings):
    seen = sightings["car"]
    rows = [SIDE / 2 - FOCAL * (z - 1.0) / (DISTANCE + BEHIND) for z in (1.5, 0.5)]
    left, right = columns((2.0, 4.0))
    assert seen.box == pytest.approx((left, rows[0], right, rows[1]), abs=1)
    assert seen.occluded == 0
    assert seen.mask.sum() == pytest.approx((right - left) * (rows[1] - rows[0]), rel=0.1)


def test_half_a_board_is_hidden(sightings):
    seen = sightings["truck"]
    left, right = columns((-4.0, -3.0))
    assert (seen.box[0], seen.box[2]) == pytest.approx((left, right), abs=1)
    assert seen.occluded == pytest.approx(0.5, abs=0.06)


def test_without_a_world_nothing_else_is_seen():
    renderer = MitsubaRenderer(build_sedan(), texture_size=8, samples=1)
    view = orbit_view(0, 0.0, DISTANCE, fov=45, width=8, height=8)
    assert renderer.sightings([view, view]) == [[], []]
