"""Meshes with bad triangles, texture coordinates, normals, units and places."""

from __future__ import annotations

import numpy as np
import pytest
from jaxtyping import Float

from tests.hard.looks import DIFFERENT, largest_z, load, look


@pytest.mark.parametrize(
    "name", ["mesh_millimetres", "mesh_kilometres", "mesh_far_away", "mesh_degenerate_triangles"]
)
def test_units_place_and_triangles_without_area_change_nothing(name):
    np.testing.assert_allclose(look(name).image, look("plain").image, rtol=1e-4)
    np.testing.assert_allclose(
        look(name).gradients[0], look("plain").gradients[0], rtol=1e-3, atol=1e-8
    )


@pytest.mark.parametrize(
    "name",
    [
        "mesh_inverted_normals",
        "mesh_inside_out",
        "mesh_pointlike_uvs",
        "mesh_line_uvs",
        "mesh_mirrored_uvs",
    ],
)
def test_normals_and_texture_coordinates_do_not_show_in_plain_paint(name):
    assert largest_z(look(name).images, look("plain").images) < DIFFERENT


@pytest.mark.parametrize("name", ["mesh_inverted_normals", "mesh_inside_out"])
def test_inverted_normals_learn_the_same(name):
    assert largest_z(look(name).gradients, look("plain").gradients) < DIFFERENT


def test_mirrored_texture_coordinates_learn_the_mirror_image():
    """Where the roof's gradient leans to the left on one it leans to the right on the other."""
    plain, mirrored = (
        roof_leaning(look(name).gradients) for name in ("plain", "mesh_mirrored_uvs")
    )
    assert largest_z(plain, -mirrored) < DIFFERENT
    assert largest_z(plain, mirrored) > DIFFERENT


def roof_leaning(gradients: Float[np.ndarray, "seeds 3 32 32"]) -> Float[np.ndarray, "seeds 3"]:
    """The gradient's moment about the middle column: the roof lies in the middle of the upper half.

    Of the upper half's faces it is the only one in sight.
    """
    u = (np.arange(32) + 0.5) / 32
    return (gradients[:, :, :16].sum(axis=2) * (u - 0.5)).sum(axis=-1)


@pytest.mark.parametrize(
    ("name", "rows", "columns"),
    [("mesh_pointlike_uvs", [15, 16], [15, 16]), ("mesh_line_uvs", [15, 16], range(32))],
)
def test_points_and_lines_of_the_texture_learn_for_their_whole_face(name, rows, columns):
    gradients = look(name).gradients
    assert set(np.flatnonzero(gradients.any(axis=(0, 1, 3)))) <= set(rows)
    assert set(np.flatnonzero(gradients.any(axis=(0, 1, 2)))) <= set(columns)
    sums, expected = (g.sum(axis=(2, 3)) for g in (gradients, look("plain").gradients))
    assert largest_z(sums, expected) < DIFFERENT


@pytest.mark.parametrize("name", ["mesh_one_pixel", "camera_fov_160"])
def test_a_vehicle_of_one_pixel_weighs_as_much_as_one_that_fills_the_picture(name):
    """Paint changes the mean in proportion to the vehicle's share of the picture's area."""
    seen = look(name)
    area = np.array([np.tan(np.radians(view.fov / 2)) ** 2 for view in seen.views])
    assert 0.5 < seen.layers.mask[0].sum() < 2
    far, near = seen.contrast * area
    hits = seen.layers.mask[0].sum() * load(name).image.samples
    assert far == pytest.approx(near, rel=float(DIFFERENT / np.sqrt(hits)))
