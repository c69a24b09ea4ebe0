"""Bad input ends with one line on stderr, exit code 2 and nothing half-written."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from cnca import cli

SCENE = """
vehicle: {{mesh: {mesh}, texture_size: 32}}
cameras: [{{name: one, azimuth: 30, elevation: 12, distance: {distance}}}]
image: {{width: 16, height: 16, samples: 1}}
{more}
"""


@pytest.fixture
def scene(tmp_path):
    def write(more="", mesh="builtin:sedan", distance=8.0) -> str:
        path = tmp_path / "scene.yaml"
        path.write_text(SCENE.format(mesh=mesh, distance=distance, more=more))
        return str(path)

    return write


@pytest.fixture
def complaint(monkeypatch, capsys, tmp_path):
    """Run the command; return its one line of complaint."""

    def run(*arguments: str) -> str:
        monkeypatch.setattr("sys.argv", ["cnca", *arguments])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        assert ended.value.code == 2
        message = capsys.readouterr().err.strip()
        assert message.startswith("error: ")
        assert len(message.splitlines()) == 1
        assert not list(tmp_path.glob("out*"))
        return message

    return run


@pytest.fixture
def out(tmp_path) -> str:
    return str(tmp_path / "out.png")


def test_missing_scene(complaint, out):
    assert "no such scene file" in complaint("render-scene", "nowhere.yaml", "-o", out)


def test_missing_mesh(complaint, scene, out):
    message = complaint("render-scene", scene(mesh="gone.obj"), "-o", out)
    assert "gone.obj" in message
    assert "no such file" in message


def test_unknown_builtin(complaint, scene, out):
    message = complaint("render-scene", scene(mesh="builtin:sedam"), "-o", out)
    assert "did you mean 'sedan'" in message


def test_mesh_without_uvs(complaint, scene, out, tmp_path):
    (tmp_path / "bare.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    message = complaint("render-scene", scene(mesh="bare.obj"), "-o", out)
    assert "bare.obj" in message
    assert "texture coordinates" in message


def test_texture_of_one_channel(complaint, scene, out, tmp_path):
    cv2.imwrite(str(tmp_path / "grey.png"), np.zeros((4, 4), np.uint8))
    texture = str(tmp_path / "grey.png")
    message = complaint("render-scene", scene(), "-o", out, "--texture", texture)
    assert "grey.png" in message
    assert "1 channel" in message


def test_texture_with_nan(complaint, scene, out, tmp_path):
    import OpenEXR

    plane = np.full((4, 4), np.nan, np.float32)
    texture = tmp_path / "holes.exr"
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, dict.fromkeys("RGB", plane)) as file:
        file.write(str(texture))
    message = complaint("render-scene", scene(), "-o", out, "--texture", str(texture))
    assert "holes.exr" in message
    assert "NaN" in message


def test_unknown_key(complaint, scene, out):
    message = complaint("render-scene", scene("fog: {visibilty: 50}"), "-o", out)
    assert "fog.visibilty" in message
    assert "did you mean 'visibility'" in message


def test_negative_visibility(complaint, scene, out):
    message = complaint("render-scene", scene("fog: {visibility: -5}"), "-o", out)
    assert "fog.visibility" in message
    assert "-5" in message


def test_zero_samples_in_the_scene(complaint, tmp_path, out):
    path = tmp_path / "scene.yaml"
    path.write_text("image: {samples: 0}")
    assert "image.samples" in complaint("render-scene", str(path), "-o", out)


def test_zero_samples_on_the_command_line(complaint, scene, out):
    assert "--spp 0" in complaint("render-scene", scene(), "-o", out, "--spp", "0")


def test_camera_inside_the_vehicle(complaint, scene, out):
    message = complaint("render-scene", scene(distance=0.1), "-o", out)
    assert "camera one" in message
    assert "inside the vehicle" in message


def test_unknown_view(complaint, scene, out):
    assert "did you mean 'one'" in complaint("render-scene", scene(), "-o", out, "--view", "onne")


def test_unknown_ending(complaint, scene, tmp_path):
    assert ".png or .exr" in complaint("render-scene", scene(), "-o", str(tmp_path / "a.jpg"))


WEIGHTS = Path(cli.__file__).parent / "assets" / "detector" / "builtin.safetensors"
OPTIMIZE = ("--prompt", "zebra", "--detector", "builtin")


@pytest.mark.skipif(not WEIGHTS.exists(), reason="the built-in detector is not trained yet")
@pytest.mark.parametrize(
    ("option", "value", "words"),
    [
        ("--steps", "0", "steps is 0"),
        ("--views-per-step", "-1", "views_per_step is -1"),
        ("--tau", "-0.5", "tau is -0.5"),
        ("--detector", "bultin", "did you mean 'builtin'"),
        ("--backend", "mitsubi", "did you mean 'mitsuba'"),
        ("--generator", "nowhere", "nowhere"),
        ("--tau", "much", "tau 'much'"),
        ("--tau", "auto", "say --min-prompt-score"),
        ("--min-prompt-score", "0.5", "belong to --tau auto"),
        ("--feature", "replaced", "did you mean 'replace'"),
        ("--update", "sing", "did you mean 'sign'"),
        ("--gradient-steps", "21", "gradient_steps is 21: there are 20 steps"),
        ("--tokens", "78", "tokens is 78: the encoder reads 77"),
        ("--device", "gpu", "device 'gpu': cannot be used"),
    ],
)
def test_optimize(complaint, scene, tmp_path, option, value, words):
    folder = str(tmp_path / "out")
    arguments = [*OPTIMIZE, "--out", folder, option, value]
    assert words in complaint("optimize", "--scene", scene(), *arguments)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "no --scene: give a scene file, or --photos with --labels"),
        (("--scene", "nowhere.yaml"), "no such scene file"),
        (("--scene", "{scene}", "--views", "1"), "--views 1"),
        (("--scene", "{scene}", "--grid", "papr"), "did you mean 'paper'"),
        (("--scene", "{scene}", "--texture", "gone.png"), "gone.png: no such file"),
        (("--scene", "{scene}", "--texture", "random=a.png"), "the name 'random' is taken"),
        (("--scene", "{scene}", "--detector", "bultin"), "did you mean 'builtin'"),
        (("--scene", "{scene}", "--scene", "{scene}"), "two files are called 'scene'"),
        (("--scene", "{scene}", "--carla", "nowhere"), "no .npz frames in this folder"),
        (("--scene", "{scene}", "--carla", "x", "--grid", "paper"), "frames have their own views"),
        (("--photos", "nowhere"), "--photos and --labels belong together"),
        (("--photos", "nowhere", "--labels", "l.json"), "no such folder"),
        (("--photos", "p", "--labels", "l.json", "--texture", "a.png"), "judged as they are"),
    ],
)
def test_evaluate(complaint, scene, tmp_path, arguments, words):
    file = scene()
    filled = [argument.format(scene=file) for argument in arguments]
    assert words in complaint("evaluate", "--out", str(tmp_path / "out"), *filled)


def test_commands_that_torchrun_does_not_divide(complaint, tmp_path, monkeypatch):
    monkeypatch.setenv("TORCHELASTIC_RUN_ID", "1")
    assert "each process would do all of it" in complaint("gallery", "--out", str(tmp_path / "g"))


def test_reorder_uv(complaint, tmp_path):
    out = str(tmp_path / "out.obj")
    assert "did you mean 'sedan'" in complaint("reorder-uv", "builtin:sedam", "-o", out)
    assert "end the name with .obj" in complaint("reorder-uv", "builtin:sedan", "-o", "a.ply")


def test_tables(complaint, scene, tmp_path):
    common = ("--scene", scene(), "--out", str(tmp_path / "out"))
    message = complaint("tradeoff", *common, "--prompt", "zebra", "--taus", "1,-2")
    assert "tau is -2" in message
    message = complaint("prompts", "zebra", *common, "--scorer", "nowhere.safetensors")
    assert "nowhere.safetensors: no prompt scorer" in message
    message = complaint("accuracy-generator", "--out", str(tmp_path / "out"), "--probes", "0")
    assert "--probes 0" in message


def test_a_missing_etron_says_what_to_put_where(complaint, tmp_path, out):
    source = Path(__file__).parents[1] / "scenes" / "etron_clear.yaml"
    copy = tmp_path / "scenes" / "etron_clear.yaml"
    copy.parent.mkdir()
    copy.write_text(source.read_text())
    message = complaint("render-scene", str(copy), "-o", out)
    assert "no such file; put the paper's E-Tron (pytorch3d_Etron.obj" in message
