"""``cnca optimize``, with a tiny generator: the run folder, going on after an interruption."""

import errno
import json
import math
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from rich.console import Console
from safetensors.torch import load_file, save_file

from cnca import cli
from cnca.attack import checkpoint
from cnca.attack.settings import Settings
from cnca.attack.targets import Target
from cnca.core.errors import DetectorError, NonFiniteError, RunError
from cnca.core.records import as_json
from cnca.detect import BUILTIN_CONFIG, detector_files
from cnca.detect.white_box import DarknetDetector
from cnca.gen.feature import StoredFeature
from cnca.jobs.attack import run
from cnca.jobs.attack.now import TEXTURE_NOW, VIEWS_NOW
from cnca.scene.load_scene import load_scene
from tests.fakes import BrightnessDetector
from tests.gen.tiny import save_pipeline, tiny_pipeline

SCENE = """
vehicle: {mesh: builtin:sedan, texture_size: 64}
variation: {distance: [6, 7], elevation: [10, 20]}
image: {width: 64, height: 64, samples: 2}
"""
STEPS = 3


class StopAfter:
    """Raises KeyboardInterrupt in place of a checkpoint's successor, as Ctrl-C would."""

    def __init__(self, monkeypatch, steps: int):
        original, self.left = checkpoint.save, steps

        def save(progress, path):
            original(progress, path)
            self.left -= 1
            if self.left == 0:
                raise KeyboardInterrupt

        monkeypatch.setattr(checkpoint, "save", save)


@pytest.fixture
def one_thread():
    """Several threads add up a gradient in an order that differs by rounding from run to run."""
    from cnca.mi_bridge.variant import dr

    threads = dr.thread_count()
    dr.set_thread_count(1)
    yield
    dr.set_thread_count(threads)


@pytest.fixture(scope="module")
def tiny(tmp_path_factory) -> Path:
    return save_pipeline(tiny_pipeline(), tmp_path_factory.mktemp("tiny"))


@pytest.fixture
def request_for(tiny, tmp_path):
    scene = tmp_path / "scene.yaml"
    scene.write_text(SCENE)

    def make(
        name: str, *, resume: bool = False, steps: int = STEPS, feature: str = "concat"
    ) -> run.Request:
        settings = Settings(
            "zebra strips", steps=steps, views_per_step=1, learning_rate=0.1, feature=feature
        )
        options = {"generator": tiny, "samples": 2, "held_out_views": 4}
        return run.Request(scene, tmp_path / name, settings, **options, resume=resume)

    return make


def quiet() -> Console:
    return Console(quiet=True)


@pytest.mark.usefixtures("one_thread")
def test_a_run_leaves_everything_and_resumes_bit_for_bit(request_for, monkeypatch):
    whole = request_for("whole")
    summary = run.run(whole, quiet())
    with monkeypatch.context() as patch:
        StopAfter(patch, 1)
        with pytest.raises(KeyboardInterrupt):
            run.run(request_for("parts"), quiet())
    parts = request_for("parts", resume=True)
    assert cv2.imread(str(parts.out / VIEWS_NOW)).shape == (64, 64, 3)
    assert len(np.unique(cv2.imread(str(parts.out / TEXTURE_NOW)))) > 2
    assert not (parts.out / "summary.json").exists()
    again = run.run(parts, quiet())

    assert again == summary
    stored = [StoredFeature.load(r.out / "F_adv.safetensors") for r in (whole, parts)]
    assert torch.equal(stored[0].feature, stored[1].feature)
    assert stored[0].prompt == "zebra strips"
    records = [json.loads(line) for line in (parts.out / "log.jsonl").read_text().splitlines()]
    assert [record["step"] for record in records] == [1, 2, 3]
    assert {"loss_adv", "D_s", "seconds_render", "seconds_backward"} <= set(records[0])
    check_summary(summary)
    check_folder(whole.out)
    assert not [*whole.out.glob("*_now.png")]

    with pytest.raises(RunError, match="already holds a run"):
        run.run(request_for("whole"), quiet())
    with pytest.raises(RunError, match="was started with another settings"):
        run.run(request_for("whole", resume=True, steps=9), quiet())


@pytest.fixture
def complaint(request_for, monkeypatch, capsys, tmp_path):
    """Begin a run whose detector lies in ``tmp_path``; return what resuming it then says."""
    for file in detector_files("builtin"):
        shutil.copy(file, tmp_path / f"own{file.suffix}")
    request = replace(request_for("begun"), detectors=(str(tmp_path / "own.cfg"),))
    run.claim(request, load_scene(request.scene), resume=False)
    options = {"scene": request.scene, "detector": request.detectors[0], "out": request.out}
    options |= {"generator": request.generator, "prompt": "zebra strips", "steps": STEPS}
    options |= {
        "views-per-step": 1,
        "learning-rate": 0.1,
        "spp": 2,
        "held-out-views": 4,
        "preset": "paper",
    }

    def resume(**changed: object) -> str:
        words = [word for k, v in (options | changed).items() for word in (f"--{k}", str(v))]
        monkeypatch.setattr("sys.argv", ["cnca", "optimize", *words, "--resume"])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        assert ended.value.code == 2
        (line,) = capsys.readouterr().err.strip().splitlines()
        assert not (request.out / "checkpoint.pt").exists()
        return line

    return resume


def test_a_run_does_not_go_on_from_what_has_changed(complaint, tmp_path):
    assert "was started with another settings.steps (was 3, now 9)" in complaint(steps=9)
    scene, names = tmp_path / "scene.yaml", tmp_path / "own.names"
    scene.write_text(SCENE.replace("[6, 7]", "[6, 8]"))
    assert f"{scene}: has changed since" in complaint()
    scene.write_text(SCENE)
    content = names.read_bytes()
    names.write_bytes(content + b"\n")
    assert f"{names}: has changed since" in complaint()
    names.write_bytes(content)
    report = tmp_path / "own.json"
    report.rename(tmp_path / "away.json")
    assert f"{report}: is gone, and" in complaint()
    (tmp_path / "away.json").rename(report)
    weights = tmp_path / "own.safetensors"
    tensors = load_file(weights)
    save_file({name: tensor + 0 for name, tensor in tensors.items()}, weights, {"of": "another"})
    assert f"{weights}: has changed since" in complaint()
    weights.unlink()
    assert "own.safetensors" in complaint()


def test_a_resumed_run_keeps_its_kind_of_feature(request_for, monkeypatch):
    with monkeypatch.context() as patch:
        StopAfter(patch, 1)
        with pytest.raises(KeyboardInterrupt):
            run.run(request_for("kind", feature="replace", steps=2), quiet())
    with pytest.raises(RunError, match="was started with another settings"):
        run.run(request_for("kind", resume=True, steps=2), quiet())
    resumed = request_for("kind", feature="replace", steps=2, resume=True)
    run.run(resumed, quiet())
    stored = StoredFeature.load(resumed.out / "F_adv.safetensors")
    assert stored.kind == "replace"
    assert stored.feature.shape == (40, 128)
    assert 0 < stored.feature.abs().max() <= stored.tau


@pytest.mark.usefixtures("one_thread")
def test_a_run_on_noises_at_another_size_resumes_bit_for_bit(request_for, monkeypatch):
    def request(name: str, *, resume: bool = False) -> run.Request:
        asked = request_for(name, resume=resume)
        settings = replace(asked.settings, variable="both", jitter=True)
        more = {"texture_size": 48, "ddim_steps": 2, "style": 4.0, "objective": "odds"}
        return replace(asked, settings=settings, **more)

    summary = run.run(request("whole"), quiet())
    with monkeypatch.context() as patch:
        StopAfter(patch, 2)
        with pytest.raises(KeyboardInterrupt):
            run.run(request("parts"), quiet())
    assert run.run(request("parts", resume=True), quiet()) == summary
    folders = [request(name).out for name in ("whole", "parts")]
    stored = [StoredFeature.load(folder / "F_adv.safetensors") for folder in folders]
    assert torch.equal(stored[0].feature, stored[1].feature)
    assert torch.equal(stored[0].noises, stored[1].noises)
    assert stored[0].noises.shape == (3, 4, 24, 24)
    assert cv2.imread(str(folders[0] / "texture.png")).shape == (48, 48, 3)


def test_a_black_box_is_refused_before_anything_is_written(request_for, monkeypatch):
    black = [Target("x.onnx", BrightnessDetector(), 0)]
    monkeypatch.setattr(run.build, "build_targets", lambda *asked: black)
    with pytest.raises(DetectorError, match="gives no gradient, so it can only judge"):
        run.run(request_for("black"), quiet())
    assert not request_for("black").out.exists()


def test_a_read_only_folder_is_told_before_the_first_step(request_for, monkeypatch):
    def refuse(*args, **kwargs):
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(tempfile, "mkdtemp", refuse)
    monkeypatch.setattr(run, "optimize", None)
    with pytest.raises(RunError, match=r"manifest\.json: cannot be written \(Read-only file sys"):
        run.run(request_for("readonly"), quiet())


def test_a_detector_that_returns_nan_once_is_told_and_survived(request_for, monkeypatch):
    calls, original = [], DarknetDetector.candidates

    def candidates(self, images):
        calls.append(len(images))
        found = original(self, images)
        return replace(found, objectness=found.objectness * (math.nan if len(calls) == 2 else 1))

    monkeypatch.setattr(DarknetDetector, "candidates", candidates)
    request = request_for("nan", steps=2)
    with pytest.raises(NonFiniteError, match=r"step 1 \(seed 1\): .* --resume tries this step"):
        run.run(request, quiet())
    run.run(replace(request, resume=True), quiet())
    records = [json.loads(line) for line in (request.out / "log.jsonl").read_text().splitlines()]
    assert [record["step"] for record in records] == [1, 2]
    assert all(math.isfinite(record["loss_adv"]) for record in records)
    assert StoredFeature.load(request.out / "F_adv.safetensors").feature.isfinite().all()


def test_an_ensemble_is_judged_detector_by_detector(request_for):
    twin = str(BUILTIN_CONFIG)
    request = replace(request_for("ensemble", steps=1), detectors=("builtin", f"{twin}=0.5"))
    summary = run.run(request, quiet())
    check_summary(summary)
    assert summary.detector == "builtin"
    both = summary.detectors
    assert [own.weight for own in both.values()] == [1.0, 0.5]
    assert replace(both["builtin"], weight=0.5) == both[twin]  # the same network by two names
    first = as_json(replace(both["builtin"], weight=None))
    assert first.items() <= json.loads((request.out / "summary.json").read_text()).items()
    record = json.loads((request.out / "log.jsonl").read_text())
    parts = record["targets"]
    assert parts["builtin"] == parts[twin]
    assert record["loss_adv"] == pytest.approx(1.5 * parts[twin]["loss_adv"])
    assert record["D_s"] == pytest.approx(parts[twin]["D_s"])
    manifest = json.loads((request.out / "manifest.json").read_text())
    assert manifest["request"]["detectors"] == ["builtin", f"{twin}=0.5"]
    assert f"Before {twin}" in (request.out / "report.html").read_text()


def check_summary(summary):
    for name in ("before", "prompt", "random", "shuffled", "after"):
        assert 0 <= summary.score(name) <= 1
        per_view = summary.scores_per_view[name]
        assert len(per_view) == summary.held_out_views == 4
        assert summary.score(name) == pytest.approx(sum(per_view) / 4, abs=1e-3)


def check_folder(out: Path):
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["request"]["settings"]["prompt"] == "zebra strips"
    hashed = {Path(name).name for name in manifest["inputs"]}
    assert {"scene.yaml", "builtin.safetensors", "model_index.json"} <= hashed
    assert "<table>" in (out / "report.html").read_text()
    for name in ("texture.png", "before_after.png"):
        assert cv2.imread(str(out / name)) is not None
    height, width, _ = cv2.imread(str(out / "before_after.png")).shape
    assert height / 2 == width / 4  # two rows of four square pictures, nothing written above them
