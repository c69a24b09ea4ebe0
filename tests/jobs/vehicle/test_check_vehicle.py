"""``cnca check-vehicle``: report, pictures and exit codes."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from cnca.cli import app
from cnca.core.errors import MeshError
from cnca.jobs.vehicle import check_vehicle as module
from cnca.jobs.vehicle.check_vehicle import check_vehicle
from cnca.scene.load_scene import load_scene
from cnca.scene.schema import VehicleSection
from cnca.vehicle.mesh.load_mesh import load_vehicle
from cnca.vehicle.mesh.pieces import read_pieces
from cnca.vehicle.mesh.write_mesh import write_obj
from cnca.vehicle.uv.uv_checkup import overlaps, skin_with_uvs

CAR = Path(__file__).parents[3] / "scenes/hard/meshes/car.obj"


def _without_uvs(folder: Path) -> Path:
    car = load_vehicle(CAR, up="z")
    write_obj(
        folder / "car.obj", replace(car, parts=tuple(replace(p, uvs=None) for p in car.parts))
    )
    return folder / "car.obj"


def test_exit_codes_and_lines(tmp_path):
    run = CliRunner().invoke
    good = run(app, ["check-vehicle", str(CAR), "--up", "z"])
    assert good.exit_code == 0
    assert "usable" in good.stdout.splitlines()
    bad = run(app, ["check-vehicle", str(_without_uvs(tmp_path)), "--up", "z"])
    assert bad.exit_code == 1
    assert bad.stdout.startswith("fault   UVs: paint have none → vehicle.unwrap: true\n")
    with pytest.raises(MeshError, match="no such file"):  # which cnca.cli.main turns into a 2
        run(app, ["check-vehicle", str(tmp_path / "none.obj")], catch_exceptions=False)


def test_the_proposed_section_makes_a_scene_that_is_good(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "SAMPLES", 4)
    out = tmp_path / "out" / "check"
    report = check_vehicle(str(_without_uvs(tmp_path)), out, up="z")
    assert not report.usable
    assert check_vehicle(str(out / "scene.yaml"), None).usable


def test_the_scene_file_moves_with_its_paths(tmp_path):
    """From a mesh to a scene file, and from that to one elsewhere: the same mesh, the same rest."""
    module._write_scene(tmp_path / "a", module.EXAMPLE, {"mesh": str(CAR), "up": "z"})
    module._write_scene(tmp_path, str(tmp_path / "a/scene.yaml"), {"mesh": "../car.obj"})
    first, second = (load_scene(tmp_path / name) for name in ("a/scene.yaml", "scene.yaml"))
    assert (first.base / first.vehicle.mesh).resolve() == CAR
    assert second.vehicle.mesh == "car.obj"
    assert first.cameras == second.cameras == load_scene(module.EXAMPLE).cameras


def test_pictures_and_json(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "SAMPLES", 4)
    printed = CliRunner().invoke(
        app, ["check-vehicle", str(CAR), "--up", "z", "--out", str(tmp_path), "--json"]
    )
    assert json.loads(printed.stdout) == json.loads((tmp_path / "vehicle.json").read_text())
    sheet = cv2.imread(str(tmp_path / "vehicle.png"))
    charts, plain, checker = np.split(sheet[-module.SHOWN :], 3, axis=1)
    assert plain.std() > 5
    # The checker is colorful, the plain shape is not.
    saturation = [np.ptp(each.astype(int), axis=2).mean() for each in (plain, checker)]
    assert saturation[1] > 2 * saturation[0]


def test_what_is_used_twice_is_marked():
    """The painted part a second time elsewhere doubles all of it, save at the charts' borders."""
    (paint,) = [
        p for p in read_pieces(VehicleSection(mesh=CAR.name), CAR.parent) if p.kind == "paint"
    ]
    skin = skin_with_uvs([paint])
    assert not overlaps(skin, 256).any()
    twice = skin_with_uvs([paint, replace(paint, vertices=paint.vertices + (10, 0, 0))])
    covered = np.abs(np.linalg.det(skin.corners[:, 1:] - skin.corners[:, :1])).sum() / 2
    assert overlaps(twice, 256).mean() == pytest.approx(covered, rel=0.1)


def test_the_file_s_own_picture_becomes_the_base_texture(tmp_path, monkeypatch):
    """Named by the MTL; upright, and only where its UVs stay."""
    monkeypatch.setattr(module, "_sheet", lambda *_: np.zeros((2, 2, 3), np.uint8))
    car = load_vehicle(CAR, up="z")
    write_obj(tmp_path / "car.obj", car)
    text = (tmp_path / "car.obj").read_text()
    (tmp_path / "car.obj").write_text("mtllib car.mtl\n" + text)
    (tmp_path / "car.mtl").write_text("newmtl paint\nmap_Kd body.png\n")
    cv2.imwrite(str(tmp_path / "body.png"), np.array([[[0, 0, 255]], [[255, 0, 0]]], np.uint8))
    out = tmp_path / "out"
    report = check_vehicle(str(tmp_path / "car.obj"), out, up="z")
    scene = load_scene(out / "scene.yaml")
    assert Path(str(report.vehicle["base_texture"])).name == module.OWN_PICTURE
    written = cv2.imread(str(scene.base / str(scene.vehicle.base_texture)))
    assert written[:, 0].tolist() == [[0, 0, 255], [255, 0, 0]]


@pytest.mark.parametrize("ending", ["dae", "usdz", "fbx"])
def test_other_formats_are_told_the_way_to_convert(tmp_path, ending):
    (tmp_path / f"car.{ending}").write_bytes(b"x")
    with pytest.raises(MeshError, match="open it in Blender and choose File, Export, glTF"):
        check_vehicle(str(tmp_path / f"car.{ending}"), None)


def test_stl_is_read(tmp_path):
    trimesh.creation.box((4.5, 1.8, 1.4)).export(tmp_path / "car.stl")
    report = check_vehicle(str(tmp_path / "car.stl"), None, up="z")
    assert report.vehicle["unwrap"] is True
