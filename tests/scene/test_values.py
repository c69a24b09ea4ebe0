"""Values as people write them."""

import pytest

from cnca.core.errors import SceneError
from cnca.scene.load_scene import load_scene


def _color(tmp_path, text):
    (tmp_path / "a.yaml").write_text(f"ground: {{color: {text}}}\n")
    return load_scene(tmp_path / "a.yaml").ground.color


@pytest.mark.parametrize("text", ["'#ff0000'", "'#F00'", "red", "[1, 0, 0]", "'rgb(255, 0, 0)'"])
def test_colors(tmp_path, text):
    assert _color(tmp_path, text) == (1, 0, 0)


@pytest.mark.parametrize("text", ["redd", "'#ff00'0", "''", "null"])
def test_what_is_no_color_is_told_what_one_is(tmp_path, text):
    with pytest.raises(SceneError, match=r"in quotes|not valid YAML"):
        _color(tmp_path, text)
