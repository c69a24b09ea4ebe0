"""Panels laid flat: closed forms for what can be developed, and the built-in sedan."""

import numpy as np
import pytest

from cnca.vehicle.builtin.sedan import build_sedan
from cnca.vehicle.uv.develop import develop, flatten
from cnca.vehicle.uv.skin import Skin

SIDE = np.array([[-1, 0, 0], [0, 0, 1]], float)
"""The left side's u and v."""


def _grid(surface, columns=24, rows=6):
    """Triangles of the surface (s, t) → (x, y, z) over the unit square."""
    s, t = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    points = np.stack(surface(s, t), axis=-1)
    a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]
    return np.concatenate([np.stack(t, 2).reshape(-1, 3, 3) for t in ((a, b, c), (a, c, d))])


def test_a_flat_panel_keeps_its_size_whatever_its_slope():
    slope = np.radians(35)
    panel = _grid(lambda s, t: (-1.2 * s, np.sin(slope) * 0.7 * t, np.cos(slope) * 0.7 * t))
    flat, stretch = flatten(panel, SIDE)
    assert flat.max(axis=(0, 1)) == pytest.approx([1.2, 0.7], rel=1e-6)
    assert stretch < 1e-6


def test_a_part_of_a_cylinder_is_as_wide_as_its_arc():
    radius, angle = 0.8, np.radians(100)

    def surface(s, t):
        turn = (s - 0.5) * angle
        return -radius * np.sin(turn), radius * np.cos(turn), 0.5 * t

    columns = 60
    flat, stretch = flatten(_grid(surface, columns), SIDE)
    # The mesh is a prism: its width is that of its chords, exactly.
    width = columns * 2 * radius * np.sin(angle / columns / 2)
    assert flat.max(axis=(0, 1)) == pytest.approx([width, 0.5], rel=1e-3)
    assert stretch < 2e-3


def test_what_is_curved_both_ways_stretches():
    def surface(s, t):
        x, z = s - 0.5, t - 0.5
        return -x, np.sqrt(1 - x**2 - z**2), z

    assert 0.01 < flatten(_grid(surface, 20, 20), SIDE)[1] < 0.2


@pytest.fixture(scope="module")
def sedan():
    vehicle = build_sedan()
    return Skin.of(vehicle), *develop(vehicle)


def test_panels_cover_the_sedan_once_under_different_names(sedan):
    skin, panels, share = sedan
    faces = np.concatenate([panel.faces for panel in panels])
    assert len(np.unique(faces)) == len(faces)
    assert len({panel.name for panel in panels}) == len(panels)
    assert 0.95 < share <= 1


def test_panels_have_the_areas_of_their_faces(sedan):
    skin, panels, _ = sedan
    for panel in panels:
        edges = np.diff(skin.vertices[skin.faces[panel.faces]][:, [0, 1, 0, 2]], axis=1)[:, ::2]
        area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum() / 2
        flat = np.linalg.det(panel.corners[:, 1:] - panel.corners[:, :1])
        assert flat.sum() / 2 == pytest.approx(area, rel=0.05)


def test_text_reads_forwards_on_both_sides(sedan):
    """No panel is mirrored: a face's corners run counter-clockwise, as seen from outside."""
    for panel in sedan[1]:
        signs = np.linalg.det(panel.corners[:, 1:] - panel.corners[:, :1])
        assert signs[signs > 0].sum() > 0.99 * np.abs(signs).sum()
