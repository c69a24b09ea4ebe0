"""Other vehicles than cars, from the scene file to the tables, and detectors of other classes."""

import json
import shutil

import pytest
import torch
from rich.console import Console

from cnca import build
from cnca.attack.settings import Settings
from cnca.core.errors import DetectorError, RunError, SceneError
from cnca.core.types import Detections
from cnca.detect import BUILTIN_CONFIG, detector_files
from cnca.jobs.attack import run
from cnca.jobs.evaluate import evaluation
from cnca.jobs.evaluate.request import EvaluationRequest as Request
from cnca.scene.load_scene import load_scene
from tests.fakes import BOX, FlatRenderer

SCENE = """
vehicle: {{mesh: builtin:sedan, texture_size: 32, label: {label}}}
image: {{width: 12, height: 12, samples: 1}}
"""
QUIET = Console(quiet=True)


class FindsAll:
    """Reports every one of its classes in the vehicle's place, the first the surest."""

    name, differentiable = "all", False

    def __init__(self, *class_names):
        self.class_names = class_names

    def detect(self, images, *, score_threshold=0.25, iou_threshold=0.45):
        count = len(self.class_names)
        scores = torch.linspace(0.8, 0.4, count) if count > 1 else torch.tensor([0.8])
        return [Detections(BOX.expand(count, 4), scores, torch.arange(count)) for _ in images]


@pytest.fixture
def evaluate(monkeypatch, tmp_path):
    """Evaluate a scene's plain paint before a detector of some classes, all else being flat."""

    def call(label, *class_names, scenes=1):
        detector = FindsAll(*class_names)
        monkeypatch.setattr(build, "build_detector", lambda spec: detector)
        monkeypatch.setattr(build, "build_renderer", lambda *a, **k: FlatRenderer())
        paths = [tmp_path / f"{label.strip()}{k}.yaml" for k in range(scenes)]
        for path in paths:
            path.write_text(SCENE.format(label=f"'{label}'"))
        request = Request(tmp_path / "out", tuple(paths), views=4, controls=())
        results = evaluation.evaluate_scenes(request, QUIET)
        text = (request.out / "results.md").read_text()
        return results, {c: m["score"].value for c, m in results.all["normal"]["all"].items()}, text

    return call


@pytest.mark.parametrize(
    ("label", "classes", "own", "vehicle"),
    [
        ("car", ("Truck", "Car"), 0.4, 0.8),
        ("truck", ("Truck", "Car"), 0.8, 0.8),
        ("car", ("vehicle",), 0.8, 0.8),
        ("Truck", ("person", "VEHICLE"), 0.4, 0.4),
        ("boat", ("person", "boat", "car"), 0.6, 0.6),
        ("motorcycle", ("motorbike", "truck"), 0.8, 0.8),
    ],
)
def test_the_scene_says_what_counts(evaluate, label, classes, own, vehicle):
    results, scores, text = evaluate(label, *classes)
    assert scores == {results.label: pytest.approx(own), "vehicle": pytest.approx(vehicle)}
    assert f"AP@0.5 of the {results.label} " in text
    stored = json.loads(json.dumps(results.all["normal"]["all"], default=vars))
    assert stored[results.label]["AP_voc"]["value"] == 1


def test_a_detector_without_the_class_is_refused_before_anything_is_rendered(evaluate, tmp_path):
    with pytest.raises(DetectorError, match=r"--detector builtin knows no class 'truck'"):
        evaluate("truck", "car", "bike")
    with pytest.raises(DetectorError, match="did you mean 'Truck'"):
        evaluate("trukc", "Truck", "Car")
    assert not (tmp_path / "out").exists()


def test_one_evaluation_is_of_one_kind_of_vehicle(tmp_path):
    paths = []
    for label in ("car", "bus"):
        paths.append(tmp_path / f"{label}.yaml")
        paths[-1].write_text(SCENE.format(label=label))
    request = Request(tmp_path / "out", tuple(paths), views=4)
    with pytest.raises(RunError, match="vehicle.label is bus, and car in .*car.yaml; evaluate one"):
        evaluation.evaluate_scenes(request, QUIET)


@pytest.mark.parametrize("label", ["''", "' '", "[]", "3"])
def test_labels_that_are_none(tmp_path, label):
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE.format(label=label))
    with pytest.raises(SceneError, match=r"vehicle\.label: "):
        load_scene(path)


def test_an_attack_takes_the_scenes_class(tmp_path):
    """The built-in detector, its vehicles renamed."""
    for file in detector_files(str(BUILTIN_CONFIG)):
        shutil.copy(file, tmp_path / f"own{file.suffix}")
    (tmp_path / "own.names").write_text("Bus\nobstacle\n")
    spec = str(tmp_path / "own.cfg")
    (target,) = build.build_targets([spec], "bus")
    assert (target.label, target.detector.class_names) == (0, ("Bus", "obstacle"))
    with pytest.raises(DetectorError, match=r"own\.cfg knows no class 'car': it has Bus"):
        build.build_targets([spec])
    scene_file = tmp_path / "scene.yaml"
    scene_file.write_text(SCENE.format(label="bus"))
    request = run.Request(scene_file, tmp_path / "out", Settings("p"), (spec,))
    assert run.assemble(request, load_scene(scene_file)).targets[0].label == 0
