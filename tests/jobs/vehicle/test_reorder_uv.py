"""``cnca reorder-uv``: what it writes, and what it refuses in one line."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from cnca.core.errors import MeshError, RunError
from cnca.core.images import write_texture_srgb
from cnca.core.records import read_record
from cnca.jobs.vehicle.reorder_uv import Reordering, checkerboard, reorder_uv
from cnca.jobs.vehicle.source import Source
from cnca.vehicle.builtin.sedan import build_sedan
from cnca.vehicle.mesh.load_mesh import load_vehicle
from cnca.vehicle.mesh.write_mesh import write_obj
from cnca.vehicle.uv.masks import paint_mask
from cnca.vehicle.uv.skin import Skin

SHARED = Path(__file__).parents[3] / "../shared/data"
ASAM = SHARED / "vehicles/asam_vehicle/vehicle_example.gltf"


def test_a_vehicle_with_mask_and_base_texture(tmp_path):
    """The right side of the sedan is painted; the base tells every place by its color."""
    sedan = build_sedan()
    mesh = tmp_path / "sedan.obj"
    write_obj(mesh, sedan)
    skin, size = Skin.of(sedan), 512
    row, column = np.mgrid[:size, :size]
    base = np.stack([column / size, row / size, np.full((size, size), 0.5)], 2).astype(np.float32)
    mask = np.zeros((size, size, 3), np.float32)
    mask[:160] = paint_mask(sedan, size)[:160, :, None]
    write_texture_srgb(tmp_path / "base.png", base)
    write_texture_srgb(tmp_path / "mask.png", mask)
    source = Source(
        str(mesh), "z", paint_mask=tmp_path / "mask.png", base_texture=tmp_path / "base.png"
    )
    report = reorder_uv(source, tmp_path / "new.obj", size=512, samples=1)

    assert read_record(Reordering, tmp_path / "new.json") == report
    assert report.vehicle == {
        "mesh": "new.obj",
        "up": "z",
        "paint_mask": "new_mask.png",
        "base_texture": "new_base.png",
    }
    assert cv2.imread(str(tmp_path / "new.png")).shape[0] > 700
    new = Skin.of(load_vehicle(tmp_path / "new.obj", up="z"))
    shown = cv2.imread(str(tmp_path / "new_base.png"))[..., ::-1] / 255
    middle = new.corners.mean(axis=1)
    texel = (middle * (512, -512) + (0, 512)).astype(int).clip(0, 511)
    was = skin.corners.mean(axis=1)
    expected = np.stack([was[:, 0], 1 - was[:, 1]], axis=1)
    found = shown[texel[:, 1], texel[:, 0], :2]
    error = np.abs(found - expected).max(axis=1)
    # A texel is about 1/80 of the longest panel: faces smaller than one show their neighbours'.
    assert np.median(error) < 0.01


def test_builtin_vehicles_need_no_file(tmp_path):
    report = reorder_uv(Source("builtin:sedan"), tmp_path / "sedan.obj", samples=1)
    assert report.was == "the file's own"
    assert report.after.seam_length < 0.5 * report.before.seam_length


@pytest.mark.skipif(not ASAM.exists(), reason="the glTF vehicle is not beside the checkout")
def test_overlapping_or_missing_coordinates_are_laid_out_anew(tmp_path):
    report = reorder_uv(Source(str(ASAM)), tmp_path / "asam.obj", samples=1)
    assert report.was.startswith("xatlas")
    assert report.after.charts < report.before.charts
    assert report.after.overlap < 0.03


def test_a_checkerboard_has_dark_and_light_squares_in_turn():
    board = checkerboard(64, 4)
    brightness = board.max(axis=2)
    assert brightness[8, 8] > 2 * brightness[8, 24]
    assert brightness[8, 24] == pytest.approx(brightness[24, 8])


@pytest.mark.parametrize(
    ("mesh", "out", "size", "message"),
    [
        ("builtin:sedam", "a.obj", 512, "did you mean 'sedan'"),
        ("gone.obj", "a.obj", 512, "gone.obj: no such file"),
        ("builtin:sedan", "a.glb", 512, "end the name with .obj"),
        ("builtin:sedan", "a.obj", 8, "--size 8"),
    ],
)
def test_bad_input_is_named_and_leaves_nothing(tmp_path, mesh, out, size, message):
    with pytest.raises((MeshError, RunError), match=message):
        reorder_uv(Source(mesh), tmp_path / out, size=size)
    assert not list(tmp_path.iterdir())
