"""The outline's measure on drawings with a known answer, then on CARLA's photographs."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from cnca.core.errors import SceneError
from cnca.scene.cameras import orbit_view
from cnca.scene.carla import carla_view, read_carla_frame
from cnca.scene.load_scene import load_scene
from cnca.vehicle.mesh.load_mesh import load_vehicle
from cnca.vehicle.model import Part, Vehicle
from cnca.vehicle.outline import (
    fit_lift,
    outline_distances,
    photographed_silhouette,
    project,
    silhouette,
)

SCENE = Path(__file__).parents[2] / "scenes/etron_carla.yaml"
VIEW = orbit_view(35, 20, 8, fov=60, width=320, height=240)


def _box() -> Vehicle:
    box = trimesh.creation.box(
        (4, 2, 1.5), transform=trimesh.transformations.translation_matrix((0, 0, 0.75))
    )
    vertices = np.array(box.vertices)
    part = Part("box", "paint", vertices, np.array(box.faces), np.array(box.vertex_normals), None)
    return Vehicle("box", (part,))


def test_projection_agrees_with_opencv():
    points = np.random.default_rng(0).uniform(-1, 1, (30, 3))
    forward = np.array(VIEW.target) - VIEW.origin
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, VIEW.up)
    right /= np.linalg.norm(right)
    world_to_camera = np.stack([right, np.cross(forward, right), forward])
    focal = VIEW.width / 2 / np.tan(np.radians(VIEW.fov / 2))
    intrinsics = np.array([[focal, 0, VIEW.width / 2], [0, focal, VIEW.height / 2], [0, 0, 1]])
    turn, _ = cv2.Rodrigues(world_to_camera)
    shift = -world_to_camera @ np.array(VIEW.origin)
    expected, _ = cv2.projectPoints(points, turn, shift, intrinsics, None)
    pixels, depth = project(points, VIEW)
    np.testing.assert_allclose(pixels, expected[:, 0], atol=1e-6)
    np.testing.assert_allclose(depth, (points - VIEW.origin) @ forward, atol=1e-9)


def test_the_silhouette_of_a_box_is_the_convex_hull_of_its_corners():
    box = _box()
    pixels, _ = project(box.parts[0].vertices, VIEW)
    hull = cv2.convexHull(pixels.astype(np.float32))
    assert silhouette(box, VIEW).sum() == pytest.approx(cv2.contourArea(hull), rel=0.02)


def test_a_vehicle_around_the_camera_is_refused():
    inside = replace(VIEW, origin=(0.5, 0.0, 0.5))
    with pytest.raises(SceneError, match="behind the camera"):
        silhouette(_box(), inside)


def _rectangle(grown: int = 0) -> np.ndarray:
    mask = np.zeros((200, 240), bool)
    mask[70 - grown : 130 + grown, 50 - grown : 190 + grown] = True
    return mask


def _photograph(mask: np.ndarray) -> np.ndarray:
    """A blue vehicle with a darker window on a rough road, a white marking right above it."""
    photograph = np.full((*mask.shape, 3), 0.45, np.float32)
    photograph += np.random.default_rng(0).normal(0, 0.03, mask.shape)[..., None]
    photograph[58:62] = 0.9
    photograph[mask] = (0.1, 0.4, 0.7)
    photograph[80:100, 70:170] = (0.3, 0.3, 0.4)
    return photograph.clip(0, 1).astype(np.float32)


@pytest.mark.parametrize("grown", [-8, -3, 0, 4, 8])
def test_the_photograph_decides_where_the_vehicle_ends(grown):
    """The marking is the stronger edge and within reach, but no part of the vehicle."""
    found = photographed_silhouette(_rectangle(grown), _photograph(_rectangle()))
    assert np.percentile(outline_distances(found, _rectangle()), 90) <= 1


@pytest.mark.parametrize("grown", [-8, -3, 0, 4, 8])
def test_a_rectangle_of_the_wrong_size_is_off_by_the_difference(grown):
    distances = outline_distances(_rectangle(grown), _rectangle())
    assert np.median(distances) == abs(grown)
    assert distances.max() <= abs(grown) * np.sqrt(2) + 1e-5  # from corner to corner


def test_the_picture_s_border_is_no_outline():
    cut_off = np.zeros((100, 100), bool)
    cut_off[:, 40:] = True
    smaller = cut_off.copy()
    smaller[:, :45] = False
    np.testing.assert_array_equal(outline_distances(cut_off, smaller), 5)


@pytest.mark.parametrize("mask", [np.zeros((50, 50), bool), np.ones((50, 50), bool)])
def test_a_picture_without_an_outline_is_refused(mask):
    with pytest.raises(SceneError, match="no outline of a vehicle"):
        photographed_silhouette(mask, np.zeros((50, 50, 3), np.float32))


@pytest.mark.parametrize("view", [VIEW, orbit_view(200, 10, 7, fov=60, width=320, height=240)])
@pytest.mark.parametrize("raised", [0.1, -0.15])
def test_a_known_lift_is_found(view, raised):
    box = _box()
    part = box.parts[0]
    lifted = Vehicle("box", (replace(part, vertices=part.vertices + (0, 0, raised)),))
    photograph = np.full((240, 320, 3), 0.5, np.float32)
    photograph[silhouette(lifted, view)] = (0.1, 0.4, 0.6)
    # An outline of whole pixels, 35 to the metre, tells the height to within half a pixel.
    assert fit_lift(box, view, photograph) == pytest.approx(raised, abs=0.015)


@pytest.fixture(scope="module")
def carla():
    """The E-Tron, and the scene's views and the pictures of CARLA's six frames of it."""
    scene = load_scene(SCENE)
    if not (scene.base / scene.cameras[0].carla).is_file():
        pytest.skip("CARLA's frames lie beside the checkout only")
    vehicle = load_vehicle(scene.base / scene.vehicle.mesh)
    views, photographs = [], []
    for camera in scene.cameras:
        frame = read_carla_frame(scene.base / camera.carla)
        size = {"width": scene.image.width, "height": scene.image.height}
        views.append(carla_view(frame.vehicle, frame.camera, lift=camera.lift, **size))
        photographs.append(frame.image)
    return vehicle, views, photographs


def _sunk(view, metres):
    """The view as it would be had the vehicle been lifted less."""
    origin, target = np.array(view.origin), np.array(view.target)
    return replace(
        view, origin=tuple(origin + (0, 0, metres)), target=tuple(target + (0, 0, metres))
    )


def _distances(vehicle, view, photograph):
    drawn = silhouette(vehicle, view)
    return outline_distances(drawn, photographed_silhouette(drawn, photograph))


def test_the_etron_meets_every_photograph_within_three_pixels(carla):
    vehicle, views, photographs = carla
    for view, photograph in zip(views, photographs, strict=True):
        assert np.median(_distances(vehicle, view, photograph)) <= 3


def test_a_vehicle_ten_centimetres_too_low_or_high_is_noticed(carla):
    vehicle, views, photographs = carla
    for metres in (-0.1, 0.1):
        for view, photograph in zip(views, photographs, strict=True):
            assert np.median(_distances(vehicle, _sunk(view, metres), photograph)) > 3


def test_the_scene_s_lifts_are_the_fitted_ones_from_eight_centimetres_away(carla):
    """To within 1 cm, which is 1 px: that much the cut at the ragged roof depends on the start."""
    vehicle, views, photographs = carla
    for view, photograph, metres in zip(views, photographs, (-0.08, 0.08) * 3, strict=True):
        fitted = fit_lift(vehicle, _sunk(view, metres), photograph)
        assert fitted == pytest.approx(metres, abs=0.01)
