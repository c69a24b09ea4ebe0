"""CARLA frames into a data set: frames that are drawn here, and the stored ones."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from rich.console import Console

from cnca import build
from cnca.core.errors import RunError
from cnca.jobs.datasets.carla import FrameProblem, FrameRecord, import_carla
from cnca.scene.carla import carla_view
from cnca.scene.schema import Scene
from cnca.vehicle.outline import silhouette

ROOT = Path(__file__).parents[3]
FRAMES = ROOT / "../shared/data/carla"
SIZE, LIFT = 400, -0.47


@pytest.fixture
def scene(tmp_path) -> Path:
    path = tmp_path / "scene.yaml"
    path.write_text("vehicle: {mesh: builtin:sedan}\n")
    return path


def write_frame(path: Path, yaw: float, lift: float = LIFT) -> None:
    """A red vehicle before grey in CARLA's axes, blue-green-red, 0.5 m above where it stands."""
    vehicle = np.array([[12.0, -7.0, 0.5], [0.0, yaw, 0.0]])
    camera = np.array([[-6.0, 2.0, 2.0], [-15.0, -18.0, 0.0]])
    view = carla_view(vehicle, camera, lift=lift, width=SIZE, height=SIZE)
    mask = silhouette(build.build_vehicle(Scene()), view)
    image = np.full((SIZE, SIZE, 3), 110, np.uint8)
    image[mask] = (30, 30, 200)
    noise = np.random.default_rng(0).integers(-9, 9, image.shape)
    np.savez(path, img=(image + noise).astype(np.uint8), veh_trans=vehicle, cam_trans=camera)


def run(folder: Path, out: Path, scene: Path) -> list:
    return import_carla(folder, out, scene, console=Console(quiet=True))


def test_drawn_frames_are_fitted_and_written(tmp_path, scene):
    frames, out = tmp_path / "frames", tmp_path / "out"
    frames.mkdir()
    write_frame(frames / "a.npz", yaw=30)
    write_frame(frames / "b.npz", yaw=200, lift=-0.53)
    records = run(frames, out, scene)
    assert [record.source for record in records] == ["a.npz", "b.npz"]
    for record, lift in zip(records, (LIFT, -0.53), strict=True):
        assert record.lift == pytest.approx(lift, abs=0.02)
        assert record.outline_pixels.median <= 1
    picture = cv2.imread(str(out / "images/000000.png"))[..., ::-1]
    mask = cv2.imread(str(out / "masks/000000.png"), cv2.IMREAD_GRAYSCALE) > 127
    red, _, blue = picture[mask].mean(axis=0)
    assert red > 150 > 60 > blue, "blue-green-red has become red-green-blue"
    outline = cv2.imread(str(out / "outlines/000000.png"))[..., ::-1]
    changed = (outline != picture).any(axis=2)
    assert 50 < changed.sum() < 4 * SIZE
    assert not changed[cv2.erode(mask.astype(np.uint8), np.ones((5, 5))) > 0].any()
    annotations = json.loads((out / "annotations.json").read_text())
    assert len(annotations["annotations"]) == 2


def test_frames_without_the_vehicle_are_named(tmp_path, scene):
    write_frame(tmp_path / "a.npz", yaw=30)
    stored = dict(np.load(tmp_path / "a.npz"))
    stored["cam_trans"][1, 1] = 120.0
    np.savez(tmp_path / "b.npz", **stored)
    good, bad = run(tmp_path, tmp_path / "out", scene)
    assert isinstance(good, FrameRecord)
    assert isinstance(bad, FrameProblem)


@pytest.mark.skipif(not FRAMES.is_dir(), reason="needs ../shared/data/carla")
def test_poses_in_radians_are_named(tmp_path):
    if not (ROOT / "../shared/data/etron").is_dir():
        pytest.skip("needs ../shared/data/etron")
    stored = dict(np.load(min(FRAMES.glob("*.npz"))))
    stored["cam_trans"] = stored["cam_trans"].copy()
    stored["cam_trans"][1] = np.radians(stored["cam_trans"][1])
    (tmp_path / "frames").mkdir()
    np.savez(tmp_path / "frames/a.npz", **stored)
    with pytest.raises(RunError, match=r"meets no frame; a\.npz"):
        run(tmp_path / "frames", tmp_path / "out", ROOT / "scenes/etron_carla.yaml")


def test_frames_of_another_folder_do_not_mix_with_those_of_a_data_set(tmp_path, scene):
    write_frame(tmp_path / "a.npz", yaw=30)
    run(tmp_path, tmp_path / "out", scene)
    (tmp_path / "a.npz").rename(tmp_path / "b.npz")
    with pytest.raises(RunError, match=r"b\.npz: was not there when .*out was started"):
        run(tmp_path, tmp_path / "out", scene)


def test_a_folder_without_frames_is_refused(tmp_path, scene):
    with pytest.raises(RunError, match=r"no \.npz frames"):
        run(tmp_path, tmp_path / "out", scene)


@pytest.mark.skipif(not FRAMES.is_dir(), reason="needs ../shared/data/carla")
def test_stored_frames_fit_within_pixels(tmp_path):
    """Without the scene's lifts: they are found, and the outlines meet as with those."""
    scene = ROOT / "scenes/etron_carla.yaml"
    if not (ROOT / "../shared/data/etron").is_dir():
        pytest.skip("needs ../shared/data/etron")
    for source in sorted(FRAMES.glob("*.npz"))[:2]:
        (tmp_path / source.name).symlink_to(source.resolve())
    for record in run(tmp_path, tmp_path / "out", scene):
        assert -0.75 < record.lift < -0.55
        assert record.outline_pixels.median <= 2
        assert record.outline_pixels.percentile_90 <= 8
