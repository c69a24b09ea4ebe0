"""A new atlas: no overlaps, the shape unchanged, one picture for all painted parts."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from cnca.core.errors import MeshError
from cnca.vehicle.builtin.sedan import build_sedan
from cnca.vehicle.model import Vehicle
from cnca.vehicle.uv.unwrap import unwrap_paint


@pytest.fixture(scope="module")
def halves():
    """A sedan whose paint comes in two parts without texture coordinates, plus its glass."""
    sedan = build_sedan()
    paint = next(part for part in sedan.parts if part.material == "paint")
    glass = next(part for part in sedan.parts if part.material == "glass")
    middle = len(paint.faces) // 2
    first = replace(paint, name="first", faces=paint.faces[:middle], uvs=None)
    second = replace(paint, name="second", faces=paint.faces[middle:], uvs=None)
    return Vehicle("halves", (first, glass, second))


@pytest.fixture(scope="module")
def unwrapped(halves):
    return unwrap_paint(halves)


def _area(points, faces):
    corners = points[faces]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    if points.shape[1] == 2:
        return np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2
    return np.linalg.norm(np.cross(a, b), axis=1) / 2


def test_shapes_and_order_stay(halves, unwrapped):
    assert [part.name for part in unwrapped.parts] == [part.name for part in halves.parts]
    assert unwrapped.parts[1] is halves.parts[1]
    for old, new in zip(halves.parts, unwrapped.parts, strict=True):
        np.testing.assert_allclose(
            old.vertices[old.faces], new.vertices[new.faces], atol=1e-6, err_msg=new.name
        )
        np.testing.assert_allclose(old.normals[old.faces], new.normals[new.faces], atol=1e-6)


def test_charts_do_not_overlap(unwrapped):
    size = 2048
    painted = [part for part in unwrapped.parts if part.material == "paint"]
    covered = np.zeros((size, size), np.uint8)
    for part in painted:
        assert part.uvs.min() >= 0
        assert part.uvs.max() <= 1
        for triangle in np.rint(part.uvs[part.faces] * size * 16).astype(np.int32):
            cv2.fillConvexPoly(covered, triangle, 1, shift=4)
    area = sum(_area(part.uvs, part.faces).sum() for part in painted)
    # Borders of charts are drawn half a texel too wide; overlaps would make the union smaller.
    assert covered.mean() >= 0.99 * area
    assert area > 0.3


def test_nothing_is_mirrored(unwrapped):
    painted = [part for part in unwrapped.parts if part.material == "paint"]
    corners = np.concatenate([part.uvs[part.faces] for part in painted])
    assert (np.linalg.det(corners[:, 1:] - corners[:, :1]) > -1e-12).all()


def test_texels_are_spread_evenly_over_the_car(unwrapped):
    parts = [part for part in unwrapped.parts if part.material == "paint"]
    density = [_area(p.uvs, p.faces).sum() / _area(p.vertices, p.faces).sum() for p in parts]
    assert max(density) < 1.3 * min(density)


def test_a_vehicle_without_paint_is_refused(halves):
    with pytest.raises(MeshError, match="no part is paint"):
        unwrap_paint(Vehicle("glass", halves.parts[1:2]))
