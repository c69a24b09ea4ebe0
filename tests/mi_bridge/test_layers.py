"""What the cameras see first, for a box whose projection is known."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from cnca.core.errors import SceneError, TextureError
from cnca.mi_bridge.geometry import Geometry
from cnca.mi_bridge.rays import Cameras
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.mi_bridge.variant import mi
from cnca.scene.cameras import View
from cnca.vehicle.builtin.props import ball, box, placed
from cnca.vehicle.model import Part, Vehicle
from tests.mi_bridge.conftest import BOX, orbit

SIDE = 64
TILTED = orbit(35, 20, 9, width=SIDE, height=SIDE)
FRONT = View("front", (10.0, 0.0, 0.7), (0.0, 0.0, 0.7), (0.0, 0.0, 1.0), 40.0, SIDE, 48)


def project(points: np.ndarray, view: View) -> np.ndarray:
    """Pixel coordinates (x, y) of world points, by the pin-hole equations."""
    origin = np.array(view.origin)
    forward = np.array(view.target) - origin
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, view.up)
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    x, y, z = np.linalg.solve(np.stack([right, down, forward], axis=1), (points - origin).T)
    focal = view.width / 2 / np.tan(np.radians(view.fov / 2))
    return np.stack([view.width / 2 + focal * x / z, view.height / 2 + focal * y / z], axis=1)


def corners() -> np.ndarray:
    signs = np.array(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [0, 1])).reshape(3, -1).T
    return signs * BOX


@pytest.mark.parametrize("view", [TILTED, FRONT, orbit(200, 60, 8, width=40, height=60)])
def test_the_box_spans_the_projected_corners(renderer, view):
    points = project(corners(), view)
    expected = [*points.min(axis=0), *points.max(axis=0)]
    found = renderer.vehicle_boxes([view])[0].tolist()
    assert found == pytest.approx(expected, abs=1.0)


def test_the_mask_has_the_projected_area(renderer):
    """The front wall alone is in sight: a rectangle, cut through pixels at its edges."""
    low, high = project(corners()[corners()[:, 0] > 0], FRONT)[[0, -1]]
    width, height = np.abs(high - low)
    mask = renderer.vehicle_mask([FRONT])[0]
    assert mask.sum() == pytest.approx(width * height, rel=0.01)
    assert ((mask >= 0) & (mask <= 1)).all()


def test_depth_of_ground_box_and_sky(renderer):
    view = FRONT
    depth = renderer.layers([view]).depth[0]
    x = (np.arange(view.width) + 0.5 - view.width / 2) / (view.width / 2)
    y = -(np.arange(view.height) + 0.5 - view.height / 2) / (view.width / 2)
    half = np.tan(np.radians(view.fov / 2))
    across, upward = np.meshgrid(half * x, half * y)
    length = np.sqrt(1 + across**2 + upward**2)
    wall = 10 - BOX[0] / 2
    on_wall = (np.abs(across * wall) < BOX[1] / 2) & (upward * wall > -0.7)
    on_wall &= upward * wall < BOX[2] - 0.7
    on_wall_depth = wall * length
    ground_depth = 0.7 / np.maximum(-upward, 1e-9) * length
    expected = np.where(on_wall, on_wall_depth, np.where(upward < 0, ground_depth, np.inf))
    expected[~on_wall & (np.abs(expected) > 2000)] = np.inf
    np.testing.assert_allclose(depth, expected, rtol=1e-4)


def test_uv_and_normals_are_those_of_the_wall_in_sight(renderer):
    """The wall at +x carries u in [0, 1/4] from its left edge to its right, v in [0, 3/4]."""
    layers = renderer.layers([FRONT])
    inside = layers.mask[0] == 1
    np.testing.assert_allclose(layers.normal[0][inside], [[1, 0, 0]] * inside.sum(), atol=1e-5)
    u, v = layers.uv[0][..., 0], layers.uv[0][..., 1]
    row, column = SIDE // 2 - 8, SIDE // 2
    assert (np.diff(u[row][inside[row]]) > 0).all()
    assert (np.diff(v[:, column][inside[:, column]]) < 0).all()
    point = 10 - layers.depth[0, row, column]
    assert point == pytest.approx(2, abs=0.05)
    assert u[inside].min() > 0
    assert u[inside].max() < 0.25
    assert v[inside].max() < 0.75
    sky = np.isinf(layers.depth[0])
    assert (layers.uv[0][sky] == 0).all()
    assert (layers.normal[0][sky] == 0).all()


def test_row_zero_of_a_texture_is_v_one(renderer):
    """A texture that is white in its lower half only: the wall shows white below v = 1/2."""
    texture = torch.zeros(3, 8, 8)
    texture[:, 4:] = 1
    renderer.geometry.bind(mi.TensorXf(texture.permute(1, 2, 0).contiguous().numpy()))
    layers = renderer.layers([FRONT])
    inside = layers.mask[0] == 1
    v, albedo = layers.uv[0][..., 1], layers.albedo[0].mean(axis=-1)
    low, high = inside & (v < 0.4), inside & (v > 0.6)
    assert low.any()
    assert high.any()
    assert albedo[low].min() > 5 * albedo[high].max()


def test_several_views_are_seen_as_if_one_at_a_time(renderer):
    views = [TILTED, orbit(200, 30, 8, width=SIDE, height=SIDE)]
    together = renderer.layers(views)
    for i, view in enumerate(views):
        alone = renderer.layers([view])
        np.testing.assert_array_equal(together.mask[i], alone.mask[0])
        np.testing.assert_array_equal(together.depth[i], alone.depth[0])


def test_props_are_no_part_of_the_mask(vehicle):
    """A ball in front of the box hides a part of it."""
    hidden = placed(ball(0.5), "trim", (4.0, 0.0), 0.0)
    bare, blocked = (
        MitsubaRenderer(vehicle, texture_size=8, props=props).vehicle_mask([FRONT])
        for props in ((), (hidden,))
    )
    assert blocked.sum() < 0.9 * bare.sum()
    assert (blocked <= bare).all()


@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.5), (1.8, 0.8, 1.4)])
def test_a_camera_inside_the_vehicle_is_refused(renderer, origin):
    view = View("driver", origin, (10.0, 0.0, 0.5), (0.0, 0.0, 1.0), 45.0, 16, 16)
    with pytest.raises(SceneError, match="camera driver: is inside the vehicle"):
        renderer.vehicle_boxes([view])


def test_a_camera_close_to_a_wall_is_not_inside(renderer):
    near = View("near", (2.05, 0.0, 0.7), (0.0, 0.0, 0.7), (0.0, 0.0, 1.0), 45.0, 16, 16)
    assert renderer.vehicle_boxes([near]).tolist() == [[0, 0, 16, 16]]


def test_a_camera_that_does_not_see_the_vehicle_is_refused(renderer):
    away = View("away", (10.0, 0.0, 1.0), (20.0, 0.0, 1.0), (0.0, 0.0, 1.0), 45.0, 16, 16)
    with pytest.raises(SceneError, match="camera away: does not see the vehicle"):
        renderer.vehicle_boxes([orbit(), away])


@pytest.mark.parametrize(
    ("views", "message"),
    [
        ([], "one picture size"),
        ([orbit(width=16), orbit(width=32)], r"\(16, 16\), \(32, 16\)"),
        ([View("a", (1.0, 2, 3), (1.0, 2, 3), (0, 0, 1.0), 45, 8, 8)], "camera a: its target is"),
        ([View("b", (0.0, 0, 9), (0.0, 0, 0), (0, 0, 1.0), 45, 8, 8)], "camera b: looks along"),
    ],
)
def test_views_that_cannot_be_drawn_are_refused(views, message):
    with pytest.raises(SceneError, match=message):
        Cameras(views)


def test_paint_without_texture_coordinates_is_refused():
    plain = box(BOX)
    bare = Part("box", "paint", plain.vertices, plain.faces, plain.normals, None)
    for part in (bare, placed(plain, "trim", (0, 0), 0.0)):
        with pytest.raises(TextureError, match="cube: no painted part with UV"):
            Geometry(Vehicle("cube", (part,)), np.full(3, 0.2), 8)
