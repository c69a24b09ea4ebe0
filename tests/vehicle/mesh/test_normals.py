"""Made normals: sharp over creases, smooth elsewhere, never zero."""

import numpy as np
import pytest
import trimesh

from cnca.vehicle.mesh.normals import creased_normals, split_normals


def _face_normals(vertices, faces):
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    return mesh.face_normals


def test_a_box_is_flat_and_a_ball_is_smooth():
    box = trimesh.creation.box((4, 2, 1))
    made = creased_normals(box.vertices, box.faces)
    np.testing.assert_allclose(made, np.repeat(box.face_normals[:, None], 3, axis=1), atol=1e-12)
    ball = trimesh.creation.icosphere(subdivisions=3)
    made = creased_normals(ball.vertices, ball.faces)
    np.testing.assert_allclose(made, ball.vertices[ball.faces], atol=0.02)


@pytest.mark.parametrize("welded", [True, False])
def test_a_sheet_with_two_sides_has_both_normals(welded):
    """Every triangle of a box twice, the second one wound backwards: sums would cancel."""
    box = trimesh.creation.box((4, 2, 1))
    faces = np.concatenate([box.faces, box.faces[:, ::-1]])
    vertices = box.vertices
    if not welded:
        vertices, faces = vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)
    _, new, normals = split_normals(vertices, faces, None)
    expected = np.repeat(_face_normals(vertices, faces)[:, None], 3, axis=1)
    np.testing.assert_allclose(normals[new], expected, atol=1e-12)


def test_good_normals_of_the_file_are_kept_and_opposed_ones_are_not():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.0]])
    faces = np.array([[0, 1, 2], [1, 3, 2]])
    slanted = np.array([[0.6, 0, 0.8], [0, 0.6, 0.8], [0, 0, 1], [0, 0, 1.0]])
    kept, new, normals = split_normals(vertices, faces, slanted)
    np.testing.assert_allclose(normals[new], slanted[faces])
    np.testing.assert_array_equal(kept[new], faces)
    opposed = slanted.copy()
    opposed[0] = (0, 0, -1)  # between this and (0, 0, 1) the normal vanishes
    _, new, normals = split_normals(vertices, faces, opposed)
    np.testing.assert_allclose(normals[new][0], [[0, 0, 1]] * 3)
    np.testing.assert_allclose(normals[new][1], slanted[faces[1]])


def test_normals_in_the_plane_of_their_face_are_made_anew():
    """A floor lit like a wall: with texture along the normal, its frame would be 0 / 0."""
    floor = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]])
    for along in ([0, -1, 0], [0, -1, 0.02]):
        given = np.tile(np.array(along) / np.linalg.norm(along), (3, 1))
        _, new, normals = split_normals(floor, np.array([[0, 1, 2]]), given)
        np.testing.assert_allclose(normals[new][0], [[0, 0, 1]] * 3)


def test_points_of_very_many_faces():
    count = 600
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    rim = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])
    vertices = np.concatenate([[[0, 0, 0.1]], rim])
    first = np.arange(count) + 1
    faces = np.column_stack([np.zeros(count, int), first, np.roll(first, -1)])
    made = creased_normals(vertices, faces)
    np.testing.assert_allclose(np.linalg.norm(made, axis=2), 1)
    assert (made[..., 2] > 0.9).all()
