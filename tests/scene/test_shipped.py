"""Shipped scenes by name, from whichever folder."""

from pathlib import Path

import pytest

from cnca.core.errors import SceneError
from cnca.scene.load_scene import load_scene
from cnca.scene.shipped import scene_file

SCENES = Path(__file__).parents[2] / "scenes"


def test_a_name_is_the_scene_at_the_top_of_the_checkout(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    named, filed = load_scene("builtin:sedan_fog"), load_scene(SCENES / "sedan_fog.yaml")
    assert named.model_copy(update={"base": filed.base}) == filed
    assert load_scene(Path("builtin:sedan_fog")) == named


def test_other_paths_stay_as_they_are():
    assert scene_file("a/builtin:b.yaml") == Path("a/builtin:b.yaml")


@pytest.mark.parametrize("name", ["builtin:sedan_claer", "builtin:", "builtin:../prices"])
def test_an_unknown_name_lists_the_known_ones(name):
    with pytest.raises(SceneError, match=r"there is .*builtin:sedan_clear, builtin:sedan_fog") as e:
        load_scene(name)
    assert ("did you mean 'builtin:sedan_clear'?" in str(e.value)) == name.endswith("claer")
