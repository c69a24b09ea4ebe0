"""``cnca train-efr`` from renders and from frames, as small as it goes."""

from __future__ import annotations

import json

import pytest
import torch
from rich.console import Console

from cnca import build
from cnca.core.errors import CncaError, RunError
from cnca.core.types import PlainPictures
from cnca.jobs import train_efr
from cnca.jobs.efr_request import EfrRequest
from cnca.mi_bridge import backgrounds
from cnca.scene.load_scene import load_scene
from cnca.scene.views import build_views
from tests.jobs.datasets.test_carla import write_frame

SCENE = """
vehicle: {mesh: builtin:sedan, texture_size: 16}
image: {width: 32, height: 24}
"""


@pytest.fixture
def call(tmp_path, monkeypatch):
    monkeypatch.setattr(train_efr, "TRUTH_SAMPLES", 8)
    monkeypatch.setattr(train_efr, "TEXTURES", 2)
    monkeypatch.setattr(backgrounds, "REFERENCE_SAMPLES", 8)
    scene = tmp_path / "scene.yaml"
    scene.write_text(SCENE)

    def run(**options):
        usual = {"carla_scene": scene, "backend": "raster", "samples": 1, "views": 4, "epochs": 1}
        usual |= {"out": tmp_path / "efr.safetensors"} | options
        resume = usual.pop("resume", False)
        return train_efr.train_efr(EfrRequest(**usual), Console(quiet=True), resume=resume)

    run.scene = scene
    return run


def test_from_renders(call, tmp_path):
    report = call(scenes=(call.scene,))
    assert (report.training_views, report.test_views) == (4, 1)
    assert report.error_after == min([report.error_before, *report.per_epoch])
    assert json.loads((tmp_path / "efr.json").read_text())["backend"] == "raster"
    residual = build.build_residual(tmp_path / "efr.safetensors")
    images = torch.rand(1, 3, 9, 9)
    plain = PlainPictures(images + 0.1, images)
    assert residual(images, [plain]).shape == images.shape
    assert 0 <= report.worse <= 1


def test_truth_and_reference_agree_in_the_plain_paint(call, monkeypatch):
    """Both are path-traced, with other random numbers; the render is not."""
    monkeypatch.setattr(train_efr, "TRUTH_SAMPLES", 128)
    monkeypatch.setattr(backgrounds, "REFERENCE_SAMPLES", 128)
    scene = load_scene(call.scene)
    studio = train_efr.Studio(scene, "raster", 1)
    shot = studio.shoot(build_views(scene)[0], scene.weather(), [None], seed=0)
    traced = shot.plain.traced
    assert torch.equal(shot.renders, shot.plain.drawn)
    assert shot.renders.shape == shot.truths.shape == traced.shape
    assert not torch.equal(shot.truths, traced)
    error = ((shot.truths - traced).abs() * shot.mask).mean()
    assert error < 0.5 * ((shot.renders - traced).abs() * shot.mask).mean()


def test_from_frames(call, tmp_path):
    for name, yaw in (("a", 30), ("b", 200)):
        write_frame(tmp_path / f"{name}.npz", yaw)
    report = call(carla=tmp_path)
    assert (report.training_views, report.test_views) == (1, 1)
    assert report.error_after < 1


def test_what_cannot_be_trained_is_refused(call, tmp_path):
    with pytest.raises(RunError, match="either --from-render"):
        call()
    with pytest.raises(RunError, match="give two or more, for training and test"):
        call(carla=tmp_path)
    with pytest.raises(RunError, match="--views 0"):
        call(scenes=(call.scene,), views=0)
    with pytest.raises(CncaError, match="backend 'tests.own_parts': unknown; there is mitsuba"):
        call(scenes=(call.scene,), backend="tests.own_parts:Poster")


def test_resumes_only_what_was_begun_from_the_same_files(call, tmp_path):
    first = call(scenes=(call.scene,))
    weights = (tmp_path / "efr.safetensors").read_bytes()
    with pytest.raises(RunError, match="efr: already holds a training; add --resume"):
        call(scenes=(call.scene,))
    again = call(scenes=(call.scene,), resume=True)
    assert again.per_epoch == first.per_epoch
    assert (tmp_path / "efr.safetensors").read_bytes() == weights
    call.scene.write_text(SCENE + "\nsky: {scale: 0.5}\n")
    with pytest.raises(RunError, match="scene.yaml: has changed since"):
        call(scenes=(call.scene,), resume=True)
