"""Polygons become triangles of the same area, convex or not, with holes on bridges too."""

import numpy as np
import pytest

from cnca.vehicle.mesh.polygons import triangulate

ARROW = [(0, 0), (2, 0), (2, 2), (1, 0.5)]
COMB = [(0, 0), (5, 0), (5, 2), (4, 2), (4, 1), (3, 1), (3, 2), (2, 2), (2, 1), (1, 1), (1, 2)]
WALL_WITH_HOLE = [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)]
"""The way into the hole and back lies on one line, as modelling programs write it."""
STAR = [
    (np.cos(a) * r, np.sin(a) * r)
    for a, r in zip(np.linspace(0, 2 * np.pi, 20, endpoint=False), [2.0, 0.7] * 10, strict=True)
]
PLANES = {"xy": np.eye(3), "turned": np.linalg.qr(np.arange(9.0).reshape(3, 3) + np.eye(3))[0]}


def _shoelace(points):
    x, y = np.array(points, float).T
    return (x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


@pytest.mark.parametrize("plane", PLANES)
@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("polygon", [ARROW, COMB, WALL_WITH_HOLE, STAR], ids=len)
def test_the_area_is_that_of_the_polygon(polygon, backwards, plane):
    points = np.column_stack([np.array(polygon, float), np.zeros(len(polygon))])
    points = points[::-1] if backwards else points
    points = points @ PLANES[plane].T + (5, -3, 2)
    triangles = points[triangulate(points)]
    crosses = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    assert np.linalg.norm(crosses, axis=1).sum() / 2 == pytest.approx(abs(_shoelace(polygon)))
    # All triangles run around as the polygon does, those without area aside.
    axis = np.cross(PLANES[plane][:, 0], PLANES[plane][:, 1])
    turns = np.sign((crosses @ axis).round(9)) * np.sign(_shoelace(polygon))
    assert set(turns) - {0} == {-1 if backwards else 1}


def test_polygons_that_cannot_be_cut_are_fans():
    line = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0.0]])
    broken = np.array([[0, 0, 0], [1, 0, 0], [1, np.nan, 0], [0, 1, 0.0]])
    for points in (line, broken):
        assert triangulate(points).tolist() == [[0, 1, 2], [0, 2, 3]]
