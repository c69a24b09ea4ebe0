"""The paint's atlas: inside the unit square, without overlaps, mirroring or much stretch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import label

from cnca.core.errors import MeshError
from cnca.vehicle.builtin.sedan import BUILTIN_VEHICLES, build_sedan
from cnca.vehicle.mesh.surface import face_crosses
from cnca.vehicle.model import Part, Vehicle
from cnca.vehicle.uv.masks import paint_mask

SIZE = 512


@pytest.fixture(scope="module", params=sorted(BUILTIN_VEHICLES))
def vehicle(request) -> Vehicle:
    return build_sedan(BUILTIN_VEHICLES[request.param])


@pytest.fixture(scope="module")
def count(vehicle) -> np.ndarray:
    return coverage(paint_of(vehicle), SIZE)


def paint_of(vehicle: Vehicle) -> Part:
    return next(part for part in vehicle.parts if part.material == "paint")


def flat_areas(part: Part) -> np.ndarray:
    """Signed areas in the atlas, positive where the texture is not mirrored."""
    assert part.uvs is not None
    (ax, ay), (bx, by), (cx, cy) = part.uvs[part.faces].transpose(1, 2, 0)
    return ((bx - ax) * (cy - ay) - (cx - ax) * (by - ay)) / 2


def coverage(part: Part, size: int) -> np.ndarray:
    """How many triangles contain each texel's centre (edge functions, row 0 is v = 1)."""
    assert part.uvs is not None
    count = np.zeros((size, size), int)
    corners = part.uvs[part.faces] * (size, -size) + (0.0, size) - 0.5
    for triangle in corners:
        low = np.ceil(triangle.min(axis=0)).astype(int)
        high = np.floor(triangle.max(axis=0)).astype(int)
        column, row = np.meshgrid(
            np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1), indexing="xy"
        )
        if not column.size:
            continue
        sides = []
        for (ax, ay), (bx, by) in zip(triangle, np.roll(triangle, -1, axis=0), strict=True):
            sides.append((bx - ax) * (row - ay) - (by - ay) * (column - ax))
        inside = np.all(np.array(sides) > 1e-9, axis=0) | np.all(np.array(sides) < -1e-9, axis=0)
        np.add.at(count, (row[inside], column[inside]), 1)
    return count


def test_atlas_lies_in_the_unit_square(vehicle):
    uvs = paint_of(vehicle).uvs
    assert uvs.min() > 4 / SIZE
    assert uvs.max() < 1 - 4 / SIZE


def test_no_texel_is_shown_twice(count):
    assert (count > 1).sum() <= 0.001 * (count > 0).sum()
    assert (count > 0).mean() > 0.25


def test_nothing_is_mirrored(vehicle):
    areas = flat_areas(paint_of(vehicle))
    assert -areas[areas < 0].sum() < 1e-4 * areas.sum()


def test_stretch_is_small(vehicle):
    """Metres of surface per unit of the atlas differ little between the panels."""
    part = paint_of(vehicle)
    surface = np.linalg.norm(face_crosses(part.vertices, part.faces), axis=1) / 2
    solid = surface > 1e-7
    surface, ratio = surface[solid], flat_areas(part)[solid] / surface[solid]
    best = ratio.max()
    # A chart's projection shortens by the cosine to its normal: cos 45° on the seams of two
    # charts, cos 55° where three meet, 1 in the middle of a panel.
    assert np.average(ratio / best, weights=surface) > 0.85
    assert surface[ratio / best < 0.5].sum() < 0.02 * surface.sum()


def test_charts_keep_their_distance(vehicle):
    """Five charts in rows: growing each by two texels joins none of them with another row's."""
    rows = paint_mask(vehicle, SIZE, padding=2).any(axis=1)
    _, bands = label(rows)
    assert bands == 4


def test_text_stands_upright_on_both_sides(vehicle):
    part = paint_of(vehicle)
    for side in (1.0, -1.0):
        flank = part.vertices[part.faces].mean(axis=1)[:, 1] * side > 0
        flank &= (np.abs(part.normals[part.faces].mean(axis=1)[:, 1])) > 0.8
        faces = part.faces[flank]
        u = part.uvs[faces] - part.uvs[faces].mean(axis=1, keepdims=True)
        x = part.vertices[faces] - part.vertices[faces].mean(axis=1, keepdims=True)
        # Reading direction, seen from outside: to the rear on the left side, forwards on the right.
        assert side * (u[..., 0] * x[..., 0]).sum() < 0
        assert (u[..., 1] * x[..., 2]).sum() > 0


def test_mask_agrees_with_texel_centres(vehicle, count):
    covered = count > 0
    bare = paint_mask(vehicle, SIZE, padding=0)
    assert bare[covered].all()
    # The drawing also touches texels whose centre is just outside of a triangle.
    assert bare.sum() < 1.12 * covered.sum()
    padded = paint_mask(vehicle, SIZE, padding=2)
    assert padded[bare].all()
    assert padded.sum() > bare.sum()


def test_mask_has_v_upwards():
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    uvs = np.array([[0.0, 0.5], [0.5, 1.0], [0.0, 1.0]])
    part = Part("roof", "paint", corners, np.array([[0, 1, 2]]), corners, uvs)
    mask = paint_mask(Vehicle("toy", (part,)), 64, padding=0)
    assert mask[0, 0]
    assert not mask[40:].any()
    assert not mask[:, 40:].any()


def test_paint_without_coordinates_is_refused():
    part = paint_of(build_sedan())
    with pytest.raises(MeshError, match="'paint' has no texture coordinates"):
        paint_mask(Vehicle("bare", (replace(part, uvs=None),)), 64)
