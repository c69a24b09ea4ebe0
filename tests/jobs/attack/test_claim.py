"""Every file that a run reads is compared when it is resumed: a changed one is named."""

import shutil
import sys
from pathlib import Path

import pytest
import yaml
from PIL import Image

from cnca.attack.settings import Settings
from cnca.core.errors import RunError
from cnca.jobs.attack.request import Request
from cnca.jobs.attack.run import claim
from cnca.scene.load_scene import load_scene

SHAPE = "v 0 0 0\nv 9 0 0\nv 0 9 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
MATERIAL = "newmtl skin\nmap_Kd {}\n"
XML = """<scene version="3.0.0">
  <shape type="obj"><string name="filename" value="floor.obj"/></shape>
</scene>
"""
SCENE = {
    "vehicle": {"mesh": "car.obj", "paint_mask": "mask.png", "base_texture": "base.png"},
    "world": {"file": "town.obj", "parts": [{"file": "house.obj", "at": [20, 20]}]},
    "sky": {"map": "sky.hdr"},
    "cameras": [{"carla": "frame.npz", "lift": 0.1}],
}
OF_SCENE = (
    *("scene.yaml", "car.obj", "car.mtl", "car.png", "mask.png", "base.png", "sky.hdr"),
    *("frame.npz", "town.obj", "town.mtl", "town.png", "house.obj"),
)
OF_XML = ("hall.xml", "floor.obj")
OF_PARTS = (
    *("eye.cfg", "eye.weights", "eye.names", "generator/model_index.json", "residual.safetensors"),
    *("my_eye.py", "my_renderer.py", "my_objective.py"),
)


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Begins a run, or goes on with it; the request names files of every kind."""
    monkeypatch.chdir(tmp_path)
    for name in ("car", "town"):
        Path(f"{name}.obj").write_text(f"mtllib {name}.mtl\nusemtl skin\n{SHAPE}")
        Path(f"{name}.mtl").write_text(MATERIAL.format(f"{name}.png"))
        Image.new("RGB", (2, 2)).save(f"{name}.png")
    for name in ("house.obj", "floor.obj"):
        Path(name).write_text(SHAPE)
    Path("hall.xml").write_text(XML)
    Path("generator").mkdir()
    for name in OF_SCENE + OF_PARTS:
        if not Path(name).exists():
            Path(name).write_text("# of the user\n")
    Path("scene.yaml").write_text(yaml.safe_dump(SCENE))

    def run(*, resume: bool):
        request = Request(
            tmp_path / "scene.yaml",
            Path("out"),
            Settings("zebra strips"),
            detectors=("eye.cfg", "my_eye:Eye"),
            generator=Path("generator"),
            efr=Path("residual.safetensors"),
            backend="my_renderer:Renderer",
            objective="my_objective:loss",
        )
        return claim(request, load_scene(request.scene), resume=resume)

    yield run
    for name in ("my_eye", "my_renderer", "my_objective"):
        sys.modules.pop(name, None)


def not_refused(run, names) -> list[str]:
    """The files that a run goes on with although they have changed."""
    run(resume=False)
    assert run(resume=True) == {}
    missed = []
    for name in names:
        content = Path(name).read_bytes()
        Path(name).write_bytes(content + b"\n")
        try:
            run(resume=True)
            missed.append(name)
        except RunError as error:
            file, _, words = str(error).partition(": ")
            assert words.startswith("has changed since out was started; bring it back or")
            assert Path(file).resolve() == Path(name).resolve()
        Path(name).write_bytes(content)
    return missed


def test_no_run_goes_on_with_another_file(run):
    assert not_refused(run, OF_SCENE + OF_PARTS) == []


def test_nor_with_another_world_in_xml(run):
    content = SCENE | {"world": {"file": "hall.xml"}}
    Path("scene.yaml").write_text(yaml.safe_dump(content))
    assert not_refused(run, OF_XML) == []


def test_a_part_of_ones_own_that_is_gone_is_named(run):
    run(resume=False)
    shutil.rmtree("generator")
    with pytest.raises(RunError, match="generator"):
        run(resume=True)
