"""Worlds as records."""

import numpy as np
import pytest

from cnca.world.model import Piece, Place, World


def test_the_place_becomes_the_origin_and_its_heading_the_x_axis():
    ahead = np.array([[3.0, 4.0 + 5.0, 1.0]])  # 5 m in front of one who stands at (3, 4) facing +y
    piece = Piece("post", "iron", ahead, np.zeros((0, 3), int), np.array([[0.0, 1.0, 0.0]]))
    place = Place(3.0, 4.0, 1.0, heading=90.0)
    moved = World("test", (piece,), {}, places=(place, Place(3.0, 6.0, 1.0, heading=180.0))).around(
        place
    )
    np.testing.assert_allclose(moved.pieces[0].vertices, [[5.0, 0.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(moved.pieces[0].normals, [[1.0, 0.0, 0.0]], atol=1e-12)
    first, second = moved.places
    assert (first.x, first.y, first.z, first.heading) == pytest.approx((0, 0, 0, 0))
    assert (second.x, second.y, second.z, second.heading) == pytest.approx((2, 0, 0, 90))
