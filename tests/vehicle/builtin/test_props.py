"""Props: closed shapes with outward faces, unit normals and texture coordinates."""

from __future__ import annotations

import numpy as np
import pytest

from cnca.scene.materials import MATERIALS
from cnca.vehicle.builtin.props import ball, box, cone, cylinder, draw_prop, placed
from cnca.vehicle.mesh.surface import face_crosses
from cnca.vehicle.model import Part

SIZE = np.array([4.0, 2.0, 1.5])
SHAPES = {
    "box": (box(SIZE), SIZE[0] * SIZE[1] * SIZE[2]),
    "cylinder": (cylinder(0.5, 2.0), np.pi * 0.5**2 * 2.0),
    "cone": (cone(0.6, 1.5), np.pi * 0.6**2 * 1.5 / 3),
    "ball": (ball(0.8), 4 / 3 * np.pi * 0.8**3),
}
each_shape = pytest.mark.parametrize("name", SHAPES)


def volume_above_ground(part: Part) -> float:
    """By the divergence theorem; a missing floor at z = 0 adds nothing."""
    areas = face_crosses(part.vertices, part.faces) / 2
    return float((part.vertices[part.faces].mean(axis=1) * areas)[:, 2].sum())


@each_shape
def test_the_volume_is_that_of_the_solid(name):
    part, expected = SHAPES[name]
    assert volume_above_ground(part) == pytest.approx(expected, rel=0.05)


@each_shape
def test_faces_and_normals_point_outwards(name):
    part, _ = SHAPES[name]
    crosses = face_crosses(part.vertices, part.faces)
    solid = np.linalg.norm(crosses, axis=1) > 1e-9  # a pole's triangles may be lines
    along = np.einsum("fcd,fd->fc", part.normals[part.faces], crosses)
    assert (along[solid] > 0).all()
    np.testing.assert_allclose(np.linalg.norm(part.normals, axis=1), 1)


@each_shape
def test_shapes_stand_on_the_ground_and_carry_a_texture(name):
    part, _ = SHAPES[name]
    assert part.vertices[:, 2].min() == pytest.approx(0, abs=1e-9)
    assert part.uvs.min() >= 0
    assert part.uvs.max() <= 1
    assert part.faces.min() == 0
    assert part.faces.max() == len(part.vertices) - 1
    assert part.material in MATERIALS


def test_the_boxes_walls_lie_apart_in_the_texture():
    """Areas in the texture add up to no more than their bounding square: nothing overlaps."""
    part = box(SIZE)
    (ax, ay), (bx, by), (cx, cy) = part.uvs[part.faces].transpose(1, 2, 0)
    areas = ((bx - ax) * (cy - ay) - (cx - ax) * (by - ay)) / 2
    assert (areas > 0).all()  # and none is mirrored
    assert areas.sum() == pytest.approx(1)


def test_placing_turns_and_moves():
    part = placed(box(SIZE), "trim", (10.0, -3.0), np.pi / 2)
    assert part.material == "trim"
    low, high = part.vertices.min(axis=0), part.vertices.max(axis=0)
    np.testing.assert_allclose(low, [10 - SIZE[1] / 2, -3 - SIZE[0] / 2, 0], atol=1e-9)
    np.testing.assert_allclose(high, [10 + SIZE[1] / 2, -3 + SIZE[0] / 2, SIZE[2]], atol=1e-9)
    crosses = face_crosses(part.vertices, part.faces)
    assert (np.einsum("fd,fd->f", part.normals[part.faces[:, 0]], crosses) > 0).all()


def test_drawn_props_follow_their_seed_and_cover_all_shapes():
    drawn = [draw_prop(np.random.default_rng(seed)) for seed in range(60)]
    assert {part.name for part in drawn} == set(SHAPES)
    again = draw_prop(np.random.default_rng(7))
    np.testing.assert_array_equal(again.vertices, drawn[7].vertices)
    for part in drawn:
        size = np.ptp(part.vertices, axis=0)
        assert 0.1 < size.max() <= 5.5
        assert np.isfinite(part.vertices).all()
