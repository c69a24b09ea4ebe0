"""The animation of a run, from small pictures of a small scene."""

import json

import cv2
import numpy as np
import pytest
from PIL import Image
from rich.console import Console

from cnca.core.errors import RunError
from cnca.jobs.view import turntable as module
from cnca.jobs.view.turntable import GAP, turntable, views_around
from cnca.jobs.view.turntable_request import TurntableRequest
from cnca.scene.schema import Scene

SCENE = "{vehicle: {texture_size: 32}, cameras: [{azimuth: 35, elevation: 20, distance: 6}]}"
QUIET = Console(quiet=True)


@pytest.fixture
def run(tmp_path):
    (tmp_path / "scene.yaml").write_text(SCENE)
    request = {"scene": str(tmp_path / "scene.yaml"), "detectors": ["builtin"]}
    content = {"job": "optimize", "request": request, "versions": {}, "inputs": {}}
    (tmp_path / "manifest.json").write_text(json.dumps(content))
    cv2.imwrite(str(tmp_path / "texture.png"), np.zeros((32, 32, 3), np.uint8))
    return tmp_path


@pytest.mark.parametrize("name", ["turntable.webp", "turn.gif"])
def test_plain_paint_and_camouflage_turn_side_by_side(run, name, monkeypatch):
    request = TurntableRequest(run, frames=3, width=48, samples=2, out=run / name)
    assert turntable(request, QUIET) == run / name
    with Image.open(run / name) as film:
        assert film.n_frames == 3
        assert film.info["loop"] == 0
        height, width = round(48 * 0.65), 2 * 48 + GAP
        assert film.size == (width, height)
        for k in range(3):
            film.seek(k)
            picture = np.asarray(film.convert("RGB")).astype(int)
            middle = slice(height // 3, 2 * height // 3)
            plain, black = (picture[middle, at + 12 : at + 36].mean() for at in (0, 48 + GAP))
            assert plain > black + 3  # as far as boxes and their labels leave them

    def refuse(*_given):
        raise AssertionError("rendered again")

    monkeypatch.setattr(module, "_photograph", refuse)
    turntable(request, QUIET)


def test_the_first_view_is_the_scenes_own_camera():
    scene = Scene.model_validate({"cameras": [{"azimuth": 35, "elevation": 20, "distance": 6}]})
    views = views_around(scene, 4, 64)
    assert [view.name for view in views] == [
        f"azimuth{azimuth}_elevation20_distance6" for azimuth in (35, 125, 215, 305)
    ]


def test_a_folder_that_is_no_finished_run(run):
    (run / "texture.png").unlink()
    with pytest.raises(RunError, match=r"no texture\.png"):
        turntable(TurntableRequest(run), QUIET)


@pytest.mark.parametrize(
    ("wrong", "complaint"),
    [
        ({"frames": 1}, "--frames 1: give 2"),
        ({"width": 8}, "--width 8: "),
        ({"samples": 0}, "--spp 0: "),
    ],
)
def test_numbers_that_are_no_pictures(tmp_path, wrong, complaint):
    with pytest.raises(RunError, match=complaint):
        TurntableRequest(tmp_path, **wrong)


def test_other_formats_are_refused(tmp_path):
    with pytest.raises(RunError, match=r"\.webp or \.gif"):
        TurntableRequest(tmp_path, out=tmp_path / "turn.mp4")
