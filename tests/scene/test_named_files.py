"""The files that a scene names are found wherever they stand in it."""

from pathlib import Path

from cnca.build import files_behind, scene_files
from cnca.scene.load_scene import load_scene
from cnca.scene.named_files import named_files

SCENE = """
vehicle: {mesh: meshes/car.gltf, paint_mask: mask.png, missing: long text, texture_size: 32}
cameras: [{carla: frame.npz, lift: 0}, {azimuth: 1, elevation: 2, distance: 3, name: "."}]
"""


def test_every_named_file_and_its_companions_are_inputs(tmp_path):
    names = ("mask.png", "frame.npz", "meshes/car.gltf", "meshes/car data.bin", "meshes/other.bin")
    (tmp_path / "meshes").mkdir()
    for name in names:
        (tmp_path / name).write_text("x")
    uris = '{"buffers": [{"uri": "car%20data.bin"}, {"uri": "data:;base64,AA=="}, {}]}'
    (tmp_path / "meshes/car.gltf").write_text(uris)
    scene_file = tmp_path / "scene.yaml"
    scene_file.write_text(SCENE)
    scene = load_scene(scene_file)
    named = [tmp_path / name for name in ("meshes/car.gltf", "mask.png", "frame.npz")]
    assert named_files(scene) == named
    assert files_behind(scene) == [*named, tmp_path / "meshes/car data.bin"]
    inputs = scene_files(scene, scene_file)
    assert inputs[0] == scene_file
    assert "prices.json" in {path.name for path in inputs}


def test_texts_that_are_no_names_of_files_are_passed_over(tmp_path):
    (tmp_path / "a.yaml").write_text(f"vehicle: {{missing: '{'long ' * 2000}'}}")
    assert named_files(load_scene(tmp_path / "a.yaml")) == []


def test_a_built_in_scene_names_no_file():
    assert named_files(load_scene("builtin:sedan_clear")) == []
    assert scene_files(load_scene("builtin:sedan_clear"), Path("builtin:sedan_clear"))[0].is_file()
