"""``cnca render-dataset``: the same pictures however the work is split."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from rich.console import Console

from cnca.core.errors import RunError
from cnca.jobs.datasets.rendered import parse_shard, render_dataset
from cnca.jobs.datasets.request import DatasetRequest

SCENE = """
vehicle: {mesh: builtin:sedan, texture_size: 16}
image: {width: 32, height: 24, samples: 2}
"""


@pytest.fixture
def render(tmp_path):
    (tmp_path / "scene.yaml").write_text(SCENE)

    def call(out: str, **options):
        request = DatasetRequest(tmp_path / "scene.yaml", tmp_path / out, **options)
        return render_dataset(request, Console(quiet=True))

    return call


def files(folder) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_shards_and_interruptions_make_the_same_files(render, tmp_path):
    assert render("whole", images=12, tar=True).rendered == 12
    assert render("parts", images=8, shard="2/2").rendered == 3
    assert render("parts", images=12, shard="1/2").rendered == 7
    report = render("parts", images=12, tar=True)
    assert (report.rendered, report.done) == (2, 12)
    assert files(tmp_path / "parts") == files(tmp_path / "whole")


def test_a_picture_is_what_its_record_says(render, tmp_path):
    render("out", images=2)
    record = json.loads((tmp_path / "out/records/000001.json").read_text())
    assert {"azimuth", "elevation", "distance", "view", "weather", "colour", "srgb"} <= set(record)
    picture = cv2.imread(str(tmp_path / "out/images/000001.png"))[..., ::-1].astype(float)
    mask = cv2.imread(str(tmp_path / "out/masks/000001.png"), cv2.IMREAD_GRAYSCALE) > 127
    assert picture.shape == (24, 32, 3)
    left, top, right, bottom = record["box_xyxy"]
    assert mask[top:bottom, left:right].sum() == mask.sum() > 20
    paint = np.median(picture[mask], axis=0) - picture[mask].mean()
    wanted = np.array(record["srgb"]) - np.mean(record["srgb"])
    if np.abs(wanted).max() > 0.1:
        assert np.dot(paint, wanted) > 0, "the vehicle has the colour of the record"


def test_another_data_set_is_not_mixed_in(render):
    render("out", images=1)
    with pytest.raises(RunError, match=r"was started with another samples \(was 2, now 4\)"):
        render("out", images=1, samples=4)


def test_a_scene_that_changed_in_between_is_refused(render, tmp_path):
    render("out", images=1)
    (tmp_path / "scene.yaml").write_text(SCENE.replace("height: 24", "height: 23"))
    with pytest.raises(RunError, match=r"another scene\.image\.height \(was 24, now 23\)"):
        render("out", images=1)


@pytest.mark.parametrize("images", [0, 10**9])
def test_more_pictures_than_the_grid_has_are_refused(render, images):
    with pytest.raises(RunError, match="grid has 1 to 46080"):
        render("out", images=images)


@pytest.mark.parametrize("text", ["0/2", "3/2", "1", "a/b", "1/0", "-1/2"])
def test_shards_that_do_not_exist_are_refused(text):
    with pytest.raises(RunError, match="such as 2/4"):
        parse_shard(text)
