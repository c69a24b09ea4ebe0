"""A user's own parts by ``module:attribute``, here from the folder of the tests."""

import re
import sys

import pytest

from cnca import build
from cnca.attack.objectives import load_objective
from cnca.core.errors import CncaError, DetectorError, GeneratorError, RunError
from cnca.core.plugins import is_plugin, load_plugin, plugin_file
from cnca.detect import detector_files, load_detector
from cnca.scene.protocols import Detector, LoopRenderer
from cnca.scene.schema import Scene
from tests import own_parts

HERE = "tests.own_parts"


def test_names_and_files_are_no_plugins(tmp_path, monkeypatch):
    assert is_plugin("a.b:C")
    assert is_plugin("a:b.c")
    for spec in ("builtin", "cached:8", "builtin:anchor-free", "a/b:c", "C:\\x", "torchvision:s:f"):
        assert not is_plugin(spec)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a:b").touch()
    assert not is_plugin("a:b")


def test_every_exchangeable_part_may_be_ones_own():
    detector = load_detector(f"{HERE}:Redness")
    assert isinstance(detector, own_parts.Redness)
    assert detector_files(f"{HERE}:Redness") == [plugin_file(f"{HERE}:x")]
    assert build.build_targets([f"{HERE}:Redness=0.5"])[0].weight == 0.5
    generator = build.build_generator(f"{HERE}:Stripes")
    assert isinstance(generator, own_parts.Stripes)
    objective = load_objective(f"{HERE}:mean_confidence")
    assert objective is own_parts.mean_confidence  # a function is an objective itself
    scene = Scene()
    renderer = build.build_loop_renderer(
        scene, vehicle=None, paint=None, backend=f"{HERE}:Poster", samples=4
    )
    assert isinstance(renderer, own_parts.Poster)
    assert (renderer.scene, renderer.samples) == (scene, 4)


def test_an_object_is_taken_as_it_is():
    assert load_plugin(f"{HERE}:REDNESS", Detector) is own_parts.REDNESS


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        (
            "tests.own_partz:Redness",
            "cannot import tests.own_partz (ModuleNotFoundError: No",
        ),
        (f"{HERE}:Rednes", "tests.own_parts has no attribute 'Rednes'; did you mean 'Redness'?"),
        (f"{HERE}:Half", "is no Detector: it lacks detect; see cnca.scene.protocols.Detector"),
        (f"{HERE}:NUMBER", "is no Detector: it lacks name, class_names"),
    ],
)
def test_what_is_missing_is_said_in_one_line(spec, words):
    with pytest.raises(DetectorError, match=re.escape(words)) as caught:
        load_detector(spec)
    assert "\n" not in str(caught.value)


def test_each_part_has_its_own_error():
    with pytest.raises(GeneratorError, match="it lacks feature_shape"):
        build.build_generator(f"{HERE}:Redness")
    with pytest.raises(CncaError, match="is no LoopRenderer: it lacks reference"):
        load_plugin(f"{HERE}:Wall", LoopRenderer, Scene(), None, None, samples=1)
    with pytest.raises(RunError, match="has no attribute 'nothing'"):
        load_objective(f"{HERE}:nothing")


def test_a_module_may_lie_in_the_folder_of_the_command(tmp_path, monkeypatch):
    (tmp_path / "lonely_part.py").write_text("from tests.own_parts import Redness\n")
    monkeypatch.chdir(tmp_path)
    before = list(sys.path)
    assert isinstance(load_detector("lonely_part:Redness"), own_parts.Redness)
    assert detector_files("lonely_part:Redness")[0].name == "lonely_part.py"
    assert sys.path == before
    del sys.modules["lonely_part"]
