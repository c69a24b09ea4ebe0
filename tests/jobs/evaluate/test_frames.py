"""Textures drawn into photographs: B + X_ren, pixel by pixel."""

from pathlib import Path

import numpy as np
import pytest
import torch

from cnca import build
from cnca.core.color import linear_to_srgb, srgb_to_linear
from cnca.core.errors import RunError, SceneError
from cnca.jobs.evaluate.frames import OverFrames, read_frames
from cnca.jobs.evaluate.parts import build_stages
from cnca.jobs.evaluate.request import EvaluationRequest
from cnca.scene.cameras import orbit_view
from cnca.scene.load_scene import load_scene
from cnca.scene.protocols import Renderer
from cnca.scene.weather import Weather
from tests.fakes import FlatRenderer

ROOT = Path(__file__).parents[3]
FRAMES = ROOT.parent / "shared" / "data" / "carla"
VIEW = orbit_view(0, 10, 7, fov=45, width=12, height=12)
needs_frames = pytest.mark.skipif(not FRAMES.exists(), reason="the CARLA frames are not there")


class HalfRenderer(FlatRenderer):
    """The vehicle covers the left half, and half of each pixel of the seventh column."""

    def vehicle_mask(self, views):
        mask = np.zeros((len(views), 12, 12), np.float32)
        mask[:, :, :6], mask[:, :, 6] = 1, 0.5
        return mask


def test_the_vehicle_is_rendered_and_the_rest_is_the_photograph():
    photograph = torch.randint(0, 256, (1, 3, 12, 12)) / 255
    over = OverFrames(HalfRenderer(), {VIEW: photograph})
    image = over.render(torch.full((3, 4, 4), 0.25), [VIEW], Weather(), seed=0)
    assert torch.equal((linear_to_srgb(image) * 255).round()[..., 7:], photograph[..., 7:] * 255)
    assert torch.allclose(image[..., :6], torch.tensor(0.25))
    half = (0.25 + srgb_to_linear(photograph)[..., 6]) / 2
    assert torch.allclose(image[..., 6], half, atol=1e-6)
    assert over.vehicle_boxes([VIEW]).tolist() == [[2, 2, 10, 10]]
    assert isinstance(over, Renderer)


def test_a_folder_without_frames_and_a_file_that_is_none(tmp_path):
    options = {"fov": 90, "kept": tmp_path / "fits", "seed": 0}
    with pytest.raises(RunError, match=r"no \.npz frames"):
        read_frames(tmp_path, None, Weather(), **options)
    (tmp_path / "a.npz").write_bytes(b"nothing")
    with pytest.raises(SceneError, match=r"a\.npz"):
        read_frames(tmp_path, None, Weather(), **options)


@needs_frames
def test_the_etron_meets_a_frame_and_the_sedan_does_not(tmp_path):
    (tmp_path / "data1.npz").symlink_to(FRAMES / "data1.npz")
    scene = load_scene(ROOT / "scenes" / "etron_clear.yaml")
    vehicle = build.build_vehicle(scene)
    options = {"fov": 90.0, "kept": tmp_path / "fits", "seed": 0}
    frames = read_frames(tmp_path, vehicle, scene.weather(), **options)
    (fit,) = frames.fits
    assert fit.used
    assert fit.outline_pixels.median <= 3
    # What the scene file of the frames states, found by a fit that began elsewhere.
    assert fit.lift == pytest.approx(-0.700, abs=0.02)
    assert frames.photograph(0).shape == (1, 3, 800, 800)
    assert read_frames(tmp_path, vehicle, scene.weather(), **options).fits == frames.fits

    request = EvaluationRequest(tmp_path, (ROOT / "scenes" / "etron_clear.yaml",), carla=tmp_path)
    (stage,) = build_stages(request, [])
    assert stage.rows[:2] == ["photograph", "normal"]
    assert isinstance(stage.renderer, OverFrames)
    assert (stage.name, stage.shots) == (tmp_path.name, frames.shots)
    assert stage.frames == frames.fits

    sedan = build.build_vehicle(load_scene(ROOT / "scenes" / "sedan_clear.yaml"))
    with pytest.raises(RunError, match="meets no frame"):
        read_frames(tmp_path, sedan, scene.weather(), **options)
