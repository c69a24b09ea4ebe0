"""``cnca harden`` from start to table, on pictures as small as can be."""

import json
from functools import partial

import numpy as np
import pytest
import torch
from rich.console import Console

import cnca.jobs.harden
from cnca.core.errors import DetectorError, RunError
from cnca.core.images import write_texture_srgb
from cnca.core.records import read_record
from cnca.detect import BUILTIN_CONFIG, load_detector
from cnca.detect.weights import stored_tensors
from cnca.jobs.harden import Change, Hardening, harden, make_cast, markdown, scene_of
from cnca.jobs.hardening_request import HardeningRequest
from cnca.judge.candidates import parse_candidates
from cnca.judge.records import Estimate
from cnca.scene.load_scene import load_scene
from cnca.train.detector import renders as detector_data
from cnca.train.detector.training import DetectorReport, Settings

SCENE = """
vehicle: {mesh: builtin:sedan, texture_size: 32}
variation: {distance: [6, 7], elevation: [10, 20]}
image: {width: 64, height: 64, samples: 2}
"""
CONSOLE = Console(quiet=True)


@pytest.fixture
def run(tmp_path):
    """The folder of an attack on a scene."""
    scene = tmp_path / "scene.yaml"
    scene.write_text(SCENE)
    folder = tmp_path / "zebra"
    stripes = np.zeros((8, 8, 3), np.float32)
    stripes[::2] = 1
    write_texture_srgb(folder / "texture.png", stripes)
    (folder / "manifest.json").write_text(json.dumps({"request": {"scene": str(scene)}}))
    return folder


@pytest.fixture
def small(monkeypatch):
    """Twelve pictures of 64 pixels in a scene."""
    draw = partial(detector_data.render_detector_data, size=64)
    monkeypatch.setattr(cnca.jobs.harden, "render_detector_data", draw)
    monkeypatch.setattr(detector_data, "PICTURES_PER_SCENE", 12)
    monkeypatch.setattr(detector_data, "WEATHERS_PER_SCENE", 1)
    monkeypatch.setattr(detector_data, "LEAST_PIXELS", 30)


def test_a_hardening_leaves_a_detector_and_a_table(run, small, tmp_path):
    out = tmp_path / "out"
    request = HardeningRequest((str(run),), out, pictures=48, epochs=1, views=4)
    results = harden(request, CONSOLE)

    labels = json.loads((out / "pictures" / "labels.json").read_text())
    assert {"camouflage zebra", "plain", "blocks"} <= set(labels["group"]) - {"empty"}

    shipped, hardened = load_detector("builtin"), load_detector(request.hardened)
    assert hardened.network.config.path.read_text() == BUILTIN_CONFIG.read_text()
    before, after = (stored_tensors(each.network) for each in (shipped, hardened))
    weights = [name for name in before if "running" not in name]
    moved = max((after[name] - before[name]).abs().max() for name in weights)
    assert 0 < moved < 6e-4  # one step of AdamW: 5e-4, and a little decay

    assert set(results.rows) == {
        "normal",
        "uniform",
        "random",
        "zebra shuffled",
        "zebra mirrored",
        "zebra mean",
        "zebra",
    }
    for by_measure in results.rows.values():
        for each in by_measure.values():
            difference = each.after.value - each.before.value
            assert each.difference.value == pytest.approx(difference, abs=2e-4)
            assert each.verdict == "too few views"
    assert read_record(Hardening, out / "hardening.json") == results
    assert (out / "hardening.md").read_text() == markdown(results)
    inputs = json.loads((out / "manifest.json").read_text())["inputs"]
    assert {"texture.png", "scene.yaml", "builtin.safetensors"} <= {
        name.rpartition("/")[2] for name in inputs
    }

    with pytest.raises(RunError, match="already holds a run; add --resume"):
        harden(request, CONSOLE)
    with pytest.raises(RunError, match=r"was started with another epochs \(was 1, now 2\)"):
        harden(
            HardeningRequest((str(run),), out, pictures=48, epochs=2, views=4), CONSOLE, resume=True
        )
    assert harden(request, CONSOLE, resume=True).rows == results.rows


def test_every_other_picture_wears_a_camouflage(run):
    candidates = parse_candidates([f"a={run}", f"b={run}"])
    cast = make_cast(load_scene(scene_of(candidates[0])), candidates)
    assert cast.groups[::2] == ("camouflage a", "camouflage b") * 5
    assert sorted(cast.groups[1::2]) == sorted(detector_data.GROUPS * 2)
    assert torch.equal(cast.textures["camouflage a"], cast.textures["camouflage b"])
    assert cast.paint.base.shape == (3, 32, 32)


def test_only_built_in_detectors(tmp_path):
    with pytest.raises(DetectorError, match=r"only built-in .* did you mean 'builtin'"):
        HardeningRequest(("a.png",), tmp_path, detector="buildin")


def test_texture_without_a_run(tmp_path):
    with pytest.raises(RunError, match=r"a\.png: no run's manifest\.json beside it; give --scene"):
        scene_of(parse_candidates([str(tmp_path / "a.png")])[0])


def test_table():
    """The verdict is on the difference, whose interval is narrower than theirs."""
    number = Estimate(0.5, 0.25, 0.75)
    change = Change(number, number, Estimate(0.0, 0.0, 0.0), "higher")
    training = DetectorReport(Settings(), {})
    text = markdown(Hardening(30, {"zebra": {"AP_voc": change, "score": change}}, training))
    assert "| zebra | 0.50 [0.25, 0.75] | 0.50 [0.25, 0.75] | higher |" in text
    assert "30 held-out views" in text
