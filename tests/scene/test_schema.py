"""Scene files: every mistake is one line with file, key, value and the nearest right key."""

from __future__ import annotations

from pathlib import Path

import pytest

from cnca.core.errors import SceneError
from cnca.scene.load_scene import load_scene
from cnca.scene.schema import CarlaCamera, OrbitCamera, Scene
from cnca.scene.weather import Fog, Weather

SCENES = Path(__file__).parents[2] / "scenes"


def write(folder: Path, text: str) -> Path:
    path = folder / "scene.yaml"
    path.write_text(text, encoding="utf-8")
    return path


MISTAKES = [
    ("sun: {altitud: 3}", "sun.altitud: unknown key; did you mean 'altitude'?"),
    ("foog: {visibility: 3}", "foog: unknown key; did you mean 'fog'?"),
    ("fog: {visibility: 3, hight: 4}", "fog.hight: unknown key; did you mean 'height'?"),
    ("image: {qqqq: 4}", "image.qqqq: unknown key"),
    ("sun: {altitude: 91}", "sun.altitude: Input should be less than or equal to 90 (got 91)"),
    ("sun: {altitude: .nan}", "sun.altitude: "),
    ("sun: {altitude: high}", "sun.altitude: Input should be a valid number"),
    ("sun: {scale: .inf}", "sun.scale: "),
    ("sun: 3", "sun: "),
    ("fog: {}", "fog.visibility: Field required"),
    ("fog: {visibility: 0}", "fog.visibility: Input should be greater than 0 (got 0)"),
    (
        "fog: {visibility: 9, asymmetry: 0.99995}",
        "fog.asymmetry: Input should be less than or equal to 0.9999 (got 0.99995)",
    ),
    ("fog: {visibility: 9, asymmetry: -1}", "fog.asymmetry: Input should be greater than or equal"),
    ("fog: {visibility: 9, albedo: 1.1}", "fog.albedo: "),
    ("sky: {turbidity: 11}", "sky.turbidity: "),
    ("ground: {color: [0.1, 0.2]}", "ground.color"),
    ("ground: {color: [0.1, 0.2, 1.5]}", "ground.color.2: "),
    ("vehicle: {up: w}", "vehicle.up: "),
    ("vehicle: {scale: 0}", "vehicle.scale: "),
    ("vehicle: {finish: {rough: 0}}", "finish.rough: unknown key; did you mean 'roughness'?"),
    ("vehicle: {finish: {metallic: 1.1}}", "vehicle.finish.metallic: "),
    ("vehicle: {texture_size: 0}", "vehicle.texture_size: "),
    ("vehicle: {mesh: 3}", "vehicle.mesh: "),
    ("image: {width: 0}", "image.width: "),
    ("image: {samples: 2.5}", "image.samples: "),
    ("variation: {azimuth: [90, 10]}", "variation.azimuth: a range is written [low, high]"),
    ("variation: {distance: [0, 10]}", "variation.distance.0: "),
    ("variation: {visibility: 10}", "variation.visibility: "),
    ("cameras: []", "cameras: "),
    ("cameras: [{azimuth: 1, elevation: 2, distence: 3}]", "did you mean 'distance'?"),
    ("cameras: [{azimuth: 1, elevation: 95, distance: 3}]", "cameras.0.elevation: "),
    ("cameras: [{azimuth: 1, elevation: 5}]", "cameras.0.distance: Field required"),
    ("cameras: [{carla: a.npz, fovv: 3}]", "cameras.0.fovv: unknown key; did you mean 'fov'?"),
    ("cameras: [{carla: a.npz, fov: 180}]", "cameras.0.fov: "),
    ("cameras: 3", "cameras: "),
    ("cameras: [3]", "cameras.0"),
    (
        "cameras: [{name: a, carla: x}, {name: b, carla: x}, {name: a, carla: y}]",
        "two cameras are named 'a'",
    ),
    ("base: /etc", "base: unknown key"),
    ("- 1", "a scene file is a mapping of sections"),
    ("just words", "a scene file is a mapping of sections"),
    ("sun: {altitude: [}", "not valid YAML"),
    ("!!python/object/apply:os.getcwd []", "not valid YAML"),
    ("1: 2", "1: Keys should be strings"),
]


@pytest.mark.parametrize(("text", "message"), MISTAKES, ids=[m[0] for m in MISTAKES])
def test_a_mistake_is_explained_in_one_line(tmp_path, text, message):
    path = write(tmp_path, text)
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    line = str(caught.value)
    assert line.startswith(f"{path}: ")
    assert message in line
    assert "\n" not in line
    assert len(line) < 400


def test_a_missing_file_a_folder_and_a_binary_file_are_named(tmp_path):
    with pytest.raises(SceneError, match="nowhere.yaml: no such scene file"):
        load_scene(tmp_path / "nowhere.yaml")
    with pytest.raises(SceneError, match="cannot be read"):
        load_scene(tmp_path)
    (tmp_path / "picture.yaml").write_bytes(b"\xff\xd8\xff")
    with pytest.raises(SceneError, match=r"picture\.yaml: byte 0 .* is not UTF-8"):
        load_scene(tmp_path / "picture.yaml")


def test_deep_nesting_is_an_error_and_no_crash(tmp_path):
    with pytest.raises(SceneError, match="not valid YAML"):
        load_scene(write(tmp_path, "[" * 20_000))


def test_an_empty_file_is_the_default_scene(tmp_path):
    scene = load_scene(write(tmp_path, ""))
    assert scene == Scene(base=tmp_path)
    assert scene.weather() == Weather()
    assert scene.cameras[0].name == "front_left"


def test_what_is_written_is_what_is_read(tmp_path):
    text = """
    sun: {altitude: 12, azimuth: -30, scale: 0.5}
    sky: {turbidity: 7, scale: 2}
    fog: {visibility: 40, height: 25, albedo: 0.9, asymmetry: -0.2}
    cameras:
      - {name: near, azimuth: 20, elevation: 5, distance: 4, target: [0, 0, 1]}
      - {carla: frames/1.npz, lift: 0.15}
    """
    scene = load_scene(write(tmp_path, text))
    assert scene.weather() == Weather(12, -30, 7, 0.5, 2, Fog(40, 25, 0.9, -0.2))
    near, frame = scene.cameras
    assert isinstance(near, OrbitCamera)
    assert near.target == (0, 0, 1)
    assert isinstance(frame, CarlaCamera)
    assert (frame.fov, frame.lift) == (90, 0.15)
    assert scene.base == tmp_path


def test_scenes_cannot_be_changed_after_reading():
    with pytest.raises(ValueError, match="frozen"):
        Scene().sun.altitude = 3


@pytest.mark.parametrize("path", sorted(SCENES.rglob("*.yaml")), ids=lambda p: p.stem)
def test_the_scenes_of_this_repository_are_valid(path):
    assert load_scene(path).cameras
