"""Cutting and making surfaces, compared with closed forms and trimesh."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from cnca.vehicle.mesh.surface import Surface, ellipsoid, face_crosses, join, revolved


def area(surface: Surface) -> float:
    return float(np.linalg.norm(face_crosses(surface.vertices, surface.faces), axis=1).sum() / 2)


def as_trimesh(surface: Surface) -> trimesh.Trimesh:
    mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    mesh.merge_vertices(digits_vertex=6)
    return mesh


@pytest.fixture
def ball() -> Surface:
    return ellipsoid((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))


def test_ellipsoid_is_closed_and_looks_outwards():
    surface = ellipsoid((1.0, 2.0, 3.0), (0.5, 1.0, 2.0))
    mesh = as_trimesh(surface)
    assert mesh.is_watertight
    # A polyhedron inside the ellipsoid, so a little less than 4/3·π·abc.
    assert 0.90 < mesh.volume / (4 / 3 * np.pi * 0.5 * 1.0 * 2.0) < 1.0
    gradient = (surface.vertices - (1.0, 2.0, 3.0)) / np.square((0.5, 1.0, 2.0))
    cosine = (gradient * surface.normals).sum(axis=1) / np.linalg.norm(gradient, axis=1)
    assert cosine.min() > 0.999


def test_cylinder_has_its_volume():
    cylinder = revolved(np.array([(0, -1), (0.5, -1), (0.5, 1), (0, 1)], float), 200)
    mesh = as_trimesh(cylinder)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(np.pi * 0.25 * 2, rel=1e-3)


def test_split_pieces_fill_the_whole(ball):
    inside, outside = ball.split(ball.z - 0.3)
    assert area(inside) + area(outside) == pytest.approx(area(ball), rel=1e-9)
    assert inside.z.max() <= 0.3 + 1e-6
    assert outside.z.min() >= 0.3 - 1e-6
    # Archimedes: the cap's area is that of the cylinder around it.
    assert area(outside) == pytest.approx(2 * np.pi * 0.7, rel=0.06)
    assert as_trimesh(join([inside, outside])).is_watertight


def test_split_keeps_the_winding(ball):
    _, cap = ball.split(ball.z - 0.3)
    crosses = face_crosses(cap.vertices, cap.faces)
    middles = cap.vertices[cap.faces].mean(axis=1)
    assert ((crosses * middles).sum(axis=1) >= 0).all()


@pytest.mark.parametrize("offset", [-5.0, 5.0])
def test_split_beyond_the_surface_leaves_one_piece_empty(ball, offset):
    inside, outside = ball.split(ball.z + offset)
    assert sorted([len(inside.faces), len(outside.faces)]) == [0, len(ball.faces)]


def test_mirrored_surface_still_looks_outwards(ball):
    moved = ball.moved((0.0, 2.0, 0.0)).mirrored()
    mesh = as_trimesh(moved)
    assert mesh.volume == pytest.approx(as_trimesh(ball).volume)
    assert moved.y.max() == pytest.approx(-1.0)


def test_recess_keeps_the_surface_closed(ball):
    inside, outside = ball.split(0.8 - ball.x)
    recessed = as_trimesh(join([inside.recessed((-0.1, 0.0, 0.0)), outside]))
    assert recessed.is_watertight
    assert recessed.is_winding_consistent
    mouth = face_crosses(inside.vertices, inside.faces)[:, 0].sum() / 2
    assert as_trimesh(ball).volume - recessed.volume == pytest.approx(0.1 * mouth, rel=1e-6)
