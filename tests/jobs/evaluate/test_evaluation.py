"""``cnca evaluate`` from start to report, on pictures as small as can be."""

import json

import cv2
import numpy as np
import pytest
from rich.console import Console

from cnca.core.errors import CncaError
from cnca.core.images import write_texture_srgb
from cnca.core.records import read_record
from cnca.detect import BUILTIN_CONFIG
from cnca.jobs.evaluate.evaluation import evaluate_scenes
from cnca.jobs.evaluate.request import EvaluationRequest
from cnca.judge.records import Evidence

pytestmark = pytest.mark.skipif(
    not BUILTIN_CONFIG.with_suffix(".safetensors").exists(),
    reason="the shipped detector is not there",
)
SCENE = """
vehicle: {mesh: builtin:sedan, texture_size: 32}
variation: {distance: [6, 7], elevation: [10, 20]}
image: {width: 64, height: 64, samples: 2}
"""


@pytest.fixture
def request_for(tmp_path):
    for name, more in (("clear", ""), ("foggy", "fog: {visibility: 60}")):
        (tmp_path / f"{name}.yaml").write_text(SCENE + more)
    run = tmp_path / "zebra"
    for name, level in (("texture.png", 0.1), ("texture_prompt.png", 0.6)):
        write_texture_srgb(run / name, np.full((8, 8, 3), level, np.float32))

    def make(out="out", **options) -> EvaluationRequest:
        scenes = (tmp_path / "clear.yaml", tmp_path / "foggy.yaml")
        defaults = {"textures": (str(run),), "views": 4}
        return EvaluationRequest(tmp_path / out, scenes, **(defaults | options))

    return make


def quiet() -> Console:
    return Console(quiet=True)


def test_an_evaluation_leaves_everything_and_a_rerun_is_the_same(request_for):
    request = request_for()
    results = evaluate_scenes(request, quiet())
    assert results.rows == [
        "normal", "uniform", "random", "zebra prompt", "zebra shuffled", "zebra mirrored",
        "zebra mean", "zebra",
    ]  # fmt: skip
    assert results.views == 8
    assert set(results.by_scene) == {"clear", "foggy"}
    own = results.all["zebra"]["total"]
    assert set(own) == {"car", "vehicle"}
    for number in own["car"].values():
        if number.value is not None:
            assert number.low <= number.high
    assert len(results.comparisons) == 7 * 2

    out = request.out
    assert read_record(Evidence, out / "results.json") == results
    text = (out / "results.md").read_text()
    assert "zebra shuffled" in text
    named = [line[2 : line.index("]")] for line in text.splitlines() if line.startswith("![")]
    assert {"sections.png", "views_clear_builtin.png"} <= set(named)
    assert all(cv2.imread(str(out / name)) is not None for name in named)
    manifest = json.loads((out / "manifest.json").read_text())
    assert any(name.endswith("zebra/texture.png") for name in manifest["inputs"])

    pictures = sorted((out / "pictures").rglob("*.npz"))
    before = [path.stat().st_mtime_ns for path in pictures]
    assert evaluate_scenes(request, quiet()) == results
    assert [path.stat().st_mtime_ns for path in pictures] == before


def test_the_grid_gives_views_and_weathers(request_for, tmp_path):
    request = request_for("grid", views=3, grid="paper", controls=(), textures=())
    results = evaluate_scenes(request, quiet())
    assert results.rows == ["normal"]
    places = {part.place for part in results.sections["distance"]}
    assert places <= {6.0, 9.0, 12.0, 15.0}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"views": 1}, "--views 1"),
        ({"samples": 0}, "--spp 0"),
        ({"grid": "papr"}, "did you mean 'paper'"),
        ({"textures": ("gone.png",)}, "gone.png: no such file"),
        ({"textures": ("normal=a.png",)}, "'normal' is taken"),
        ({"detectors": ("builtin", "builtin")}, "two detectors are called 'builtin'"),
        ({"detectors": ("bultin",)}, "did you mean 'builtin'"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(request_for, options, words):
    with pytest.raises(CncaError, match=words) as caught:
        evaluate_scenes(request_for("bad", **options), quiet())
    assert "\n" not in str(caught.value)
    assert not (request_for("bad").out).exists()
