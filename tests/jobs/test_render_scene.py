"""``cnca render-scene``: pictures, layers and records."""

import json
import subprocess
import sys

import cv2
import numpy as np
import OpenEXR
import pytest

from cnca import cli

SCENE = """
vehicle: {mesh: builtin:sedan, paint: [0.1, 0.2, 0.8], texture_size: 32}
cameras:
  - {name: left, azimuth: 90, elevation: 10, distance: 8}
  - {name: front, azimuth: 0, elevation: 10, distance: 8}
image: {width: 48, height: 32, samples: 4}
"""

SPARED = {
    *("trimesh", "networkx", "scipy", "diffusers", "transformers", "onnxruntime"),
    *("matplotlib", "pandas", "colour", "torchvision"),
}
"""Libraries that a picture of a built-in vehicle needs nothing of; some take a second to import."""
LIST_MODULES = """
import sys
from cnca.cli import main
try:
    main()
finally:
    print(*sys.modules, file=sys.stderr)
"""


@pytest.fixture
def cnca(monkeypatch, tmp_path):
    scene = tmp_path / "scene.yaml"
    scene.write_text(SCENE)

    def run(*arguments: str) -> None:
        monkeypatch.setattr("sys.argv", ["cnca", "render-scene", str(scene), *arguments])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        assert not ended.value.code

    return run


def test_picture_and_record(cnca, tmp_path):
    cnca("-o", str(tmp_path / "a.png"), "--seed", "3")
    picture = cv2.imread(str(tmp_path / "a.png"))
    assert picture.shape == (32, 48, 3)
    record = json.loads((tmp_path / "a.json").read_text())
    assert record["view"]["name"] == "left"
    assert record["seed"] == 3
    assert {row["effect"] for row in record["plan"]} >= {"fog", "sun", "sky", "interreflection"}
    assert record["seconds"]["first"] > 0
    assert record["seconds"]["steady"] > 0
    assert record["versions"]["mitsuba"].startswith("3.9")
    left, top, right, bottom = record["vehicle_box_xyxy"]
    assert 0 <= left < right <= 48
    assert 0 <= top < bottom <= 32
    middle = picture[int(top + bottom) // 2, int(left + right) // 2].astype(int)
    assert middle[0] > middle[2] + 20, "the blue paint is blue (OpenCV: blue first)"


def test_a_picture_loads_only_what_it_needs(tmp_path):
    (tmp_path / "scene.yaml").write_text(SCENE)
    command = [sys.executable, "-c", LIST_MODULES, "render-scene", "scene.yaml", "-o", "a.png"]
    answer = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    loaded = {name.split(".")[0] for name in answer.stderr.split()}
    assert {"torch", "mitsuba"} <= loaded
    assert loaded & SPARED == set()


def test_layers_agree_with_each_other(cnca, tmp_path):
    cnca("-o", str(tmp_path / "a.exr"))
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        layers = {name: channel.pixels for name, channel in file.channels().items()}
    mask, depth = layers["mask"], layers["depth"]
    covered = mask == 1
    assert covered.any()
    assert (mask == 0).any()
    assert np.all((depth[covered] > 5) & (depth[covered] < 11))
    normal = np.stack([layers[f"normal.{c}"] for c in "RGB"], axis=-1)
    assert np.allclose(np.linalg.norm(normal[covered], axis=-1), 1, atol=1e-3)
    record = json.loads((tmp_path / "a.json").read_text())
    columns = np.flatnonzero((mask > 0).any(axis=0))
    assert record["vehicle_box_xyxy"][0] == columns[0]
    assert record["vehicle_box_xyxy"][2] == columns[-1] + 1
    assert np.isfinite(layers["R"]).all()
    assert layers["R"].min() >= 0
    painted = (layers["uv.R"] > 0) & covered
    blue = layers["albedo.B"][painted] - layers["albedo.R"][painted]
    assert np.median(blue) > 0.3, "most of what has texture coordinates is blue paint"


def test_every_view_has_its_file(cnca, tmp_path, capsys):
    cnca("-o", str(tmp_path / "b.png"), "--all-views", "--json")
    records = json.loads(capsys.readouterr().out)
    assert [record["picture"] for record in records] == ["b_left.png", "b_front.png"]
    assert (tmp_path / "b_left.png").exists()
    assert (tmp_path / "b_front.json").exists()


def test_the_seed_decides_the_noise(cnca, tmp_path):
    for name, seed in (("a", "1"), ("b", "1"), ("c", "2")):
        cnca("-o", str(tmp_path / f"{name}.png"), "--seed", seed)
    first, again, other = ((tmp_path / f"{n}.png").read_bytes() for n in "abc")
    assert first == again
    assert first != other


def test_texture_is_the_paint(cnca, tmp_path):
    cv2.imwrite(str(tmp_path / "green.png"), np.full((8, 8, 3), (0, 200, 0), np.uint8))
    cnca("-o", str(tmp_path / "a.png"), "--texture", str(tmp_path / "green.png"))
    left, top, right, bottom = json.loads((tmp_path / "a.json").read_text())["vehicle_box_xyxy"]
    car = cv2.imread(str(tmp_path / "a.png"))[int(top) : int(bottom), int(left) : int(right)]
    assert (car[..., 1].astype(int) > car[..., 2].astype(int) + 30).mean() > 0.15


def test_explain_prints_the_plan(cnca, tmp_path, capsys):
    cnca("-o", str(tmp_path / "a.png"), "--explain")
    printed = capsys.readouterr().out
    assert "interreflection" in printed
    assert "the scene has no fog" in printed


def plan_of(tmp_path) -> dict[str, dict]:
    """Effect → row of the record."""
    record = json.loads((tmp_path / "a.json").read_text())
    return {row["effect"]: row for row in record["plan"]}


def test_the_plan_holds_models_errors_and_shares_of_the_time(cnca, tmp_path):
    cnca("-o", str(tmp_path / "a.png"))
    rows = plan_of(tmp_path)
    assert rows["interreflection"]["model"] == 2
    assert rows["gradient"]["model"] == "off"
    assert rows["samples"]["model"] == 4
    assert 0 < rows["interreflection"]["error"] < rows["samples"]["error"] < rows["all"]["error"]
    assert sum(row["time_share"] for row in rows.values()) == pytest.approx(2, abs=2e-3)


def test_a_target_error_chooses_models_and_samples(cnca, tmp_path):
    cnca("-o", str(tmp_path / "a.png"), "--target-error", "0.15")
    rows = plan_of(tmp_path)
    assert rows["all"]["error"] <= 0.15
    assert rows["samples"]["model"] != 4
    cnca("-o", str(tmp_path / "a.png"), "--target-error", "0.15", "--spp", "8")
    assert plan_of(tmp_path)["samples"]["model"] == 8


def test_reference_and_effects_by_name(cnca, tmp_path):
    cnca(
        "-o", str(tmp_path / "a.png"), "--reference", "--spp", "2", "--effect", "materials=diffuse"
    )
    models = {effect: row["model"] for effect, row in plan_of(tmp_path).items()}
    assert (models["sun"], models["interreflection"]) == ("disc", 8)
    assert (models["materials"], models["samples"]) == ("diffuse", 2)


def test_an_unknown_effect_ends_with_one_line(monkeypatch, tmp_path, capsys):
    arguments = ["cnca", "render-scene", "x.yaml", "-o", str(tmp_path / "a.png")]
    monkeypatch.setattr("sys.argv", [*arguments, "--effect", "fgo=none"])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    assert "did you mean 'fog'" in capsys.readouterr().err
