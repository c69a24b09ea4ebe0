"""CARLA's left-handed poses against scipy's rotations, and its frames as files."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cnca.core.errors import SceneError
from cnca.scene.carla import carla_view, read_carla_frame, rotation
from cnca.vehicle.outline import project

SHARED = Path(__file__).parents[2] / "../shared"
MIRROR = np.diag([1.0, -1.0, 1.0])


def _right_handed(pitch, yaw, roll):
    """The same pose after y was mirrored: looking up and turning right become negative angles."""
    return Rotation.from_euler("ZYX", [-yaw, -pitch, roll], degrees=True).as_matrix()


@pytest.mark.parametrize("angles", [(0, 0, 0), (30, 0, 0), (0, 40, 0), (0, 0, 50), (-20, 130, 15)])
def test_rotation_agrees_with_scipy(angles):
    np.testing.assert_allclose(
        rotation(*angles), MIRROR @ _right_handed(*angles) @ MIRROR, atol=1e-12
    )


def test_the_view_direction_is_the_documented_one():
    pitch, yaw = np.radians([-22.5, -135])
    camera = np.array([[3.27, 3.27, 1.91], [-22.5, -135, 0]])
    view = carla_view(np.zeros((2, 3)), camera, lift=0, width=8, height=8)
    direction = np.array(view.target) - view.origin
    expected = (np.cos(yaw) * np.cos(pitch), -np.sin(yaw) * np.cos(pitch), np.sin(pitch))
    np.testing.assert_allclose(direction, expected, atol=1e-12)
    np.testing.assert_allclose(view.origin, (3.27, -3.27, 1.91))


def test_points_of_the_vehicle_land_on_the_pixels_that_carla_draws():
    """A pinhole camera written down in CARLA's own frame: x is depth, y right, z up."""
    rng = np.random.default_rng(0)
    vehicle = np.array([[100.0, -50, 0.6], [4, 77, -3]])
    camera = np.array([[-6.0, 1.5, 2.2], [-14, 8, 6]])
    lift, fov, width, height = -0.6, 70.0, 640, 480
    ours = rng.uniform((-1, -1, 0), (1, 1, 1.5), (20, 3))  # +y left, z = 0 on the ground

    body = MIRROR @ _right_handed(*vehicle[1]) @ MIRROR
    world_parallel = ((ours + (0, 0, lift)) @ MIRROR) @ body.T
    lens = MIRROR @ _right_handed(*camera[1]) @ MIRROR
    x, y, z = ((world_parallel - camera[0]) @ lens).T
    focal = width / 2 / np.tan(np.radians(fov / 2))
    expected = np.stack([width / 2 + focal * y / x, height / 2 - focal * z / x], axis=1)

    view = carla_view(vehicle, camera, lift=lift, width=width, height=height, fov=fov)
    pixels, depth = project(ours, view)
    np.testing.assert_allclose(pixels, expected, atol=1e-9)
    np.testing.assert_allclose(depth, x, atol=1e-9)


def _store(path, **changes):
    arrays = {
        "img": np.zeros((4, 6, 3), np.uint8),
        "veh_trans": np.zeros((2, 3)),
        "cam_trans": np.ones((2, 3)),
    }
    arrays.update(changes)
    np.savez(path, **{key: value for key, value in arrays.items() if value is not None})
    return path


def test_a_frame_becomes_red_green_blue_in_unit_range(tmp_path):
    blue = np.zeros((4, 6, 3), np.uint8)
    blue[..., 0] = 255
    frame = read_carla_frame(_store(tmp_path / "f.npz", img=blue))
    np.testing.assert_array_equal(frame.image[0, 0], (0, 0, 1))
    np.testing.assert_array_equal(frame.camera, np.ones((2, 3)))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"veh_trans": None}, "veh_trans"),
        ({"cam_trans": np.zeros(3)}, "cam_trans: expected 2 × 3"),
        ({"cam_trans": np.full((2, 3), np.nan)}, "cam_trans: expected 2 × 3 finite"),
        ({"veh_trans": np.full((2, 3), "east")}, "veh_trans: expected 2 × 3 finite numbers"),
        ({"veh_trans": np.zeros((2, 3), complex)}, "veh_trans: expected 2 × 3 finite numbers"),
        ({"img": np.zeros((4, 6), np.uint8)}, "img: expected uint8"),
        ({"img": np.array([object()])}, "cannot be read"),
    ],
)
def test_bad_frames_are_refused_in_one_line(tmp_path, changes, message):
    path = _store(tmp_path / "f.npz", **changes)
    with pytest.raises(SceneError, match=message) as caught:
        read_carla_frame(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_and_broken_files_are_refused(tmp_path):
    with pytest.raises(SceneError, match="no such CARLA frame"):
        read_carla_frame(tmp_path / "none.npz")
    (tmp_path / "broken.npz").write_bytes(b"broken")
    with pytest.raises(SceneError, match="cannot be read"):
        read_carla_frame(tmp_path / "broken.npz")
