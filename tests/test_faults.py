"""Files that once failed, and vehicles of the world: each is read rightly, or refused by name."""

import shlex
from pathlib import Path

import numpy as np
import pytest

from cnca import build
from cnca.cli.app import app
from cnca.core.errors import MeshError
from cnca.jobs.vehicle import check_vehicle as module
from cnca.jobs.vehicle.check_vehicle import check_vehicle
from cnca.scene.load_scene import load_scene
from cnca.scene.schema import VehicleSection
from cnca.vehicle.mesh import sight
from cnca.vehicle.mesh.load_mesh import load_vehicle
from cnca.vehicle.mesh.mesh_file import read_meshes
from cnca.vehicle.mesh.pieces import read_pieces
from cnca.world.mesh import load_world

SHARED = Path(__file__).parents[1] / "../shared/data"
FAULTS, VEHICLES, WORLDS = (SHARED / name for name in ("faults", "vehicles", "worlds"))
GLTF = FAULTS / "gltf-normalized-sparse-draco"
REFUSED = {
    GLTF / "draco.gltf": "KHR_draco_mesh_compression: its data cannot be decoded",
    GLTF / "meshopt.gltf": "EXT_meshopt_compression: its data cannot be decoded",
}
"""Their compressed blocks hold something else."""
ENDINGS = (".obj", ".gltf", ".glb")
MESHES = [
    path
    for folder in (FAULTS, VEHICLES)
    for path in (sorted(folder.rglob("*")) if folder.exists() else ())
    if path.suffix in ENDINGS and path not in REFUSED
]
LARGE = [path for path in MESHES if path.stat().st_size > 1e6]

each_mesh = pytest.mark.parametrize(
    "path",
    [pytest.param(p, marks=pytest.mark.slow) if p in LARGE else p for p in MESHES],
    ids=lambda path: f"{path.parent.name}-{path.name}",
)
needs_faults = pytest.mark.skipif(not FAULTS.exists(), reason="needs ../shared/data/faults")


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    """Coarse looks and pictures: fine ones are other tests' subject."""
    monkeypatch.setattr(sight, "SAMPLES", 20_000)
    monkeypatch.setattr(module, "SHOWN", 64)
    monkeypatch.setattr(module, "SAMPLES", 1)


@each_mesh
def test_what_is_proposed_passes_the_check_at_once(path, tmp_path):
    """Its scene has no fault, is painted where one sees it, and has unit normals everywhere."""
    report = check_vehicle(str(path), tmp_path)
    scene = load_scene(tmp_path / "scene.yaml")
    assert check_vehicle(str(tmp_path / "scene.yaml"), None).usable
    vehicle = build.build_vehicle(scene)
    build.build_paint(scene, vehicle)
    for part in vehicle.parts:
        np.testing.assert_allclose(np.linalg.norm(part.normals, axis=1), 1, atol=1e-6)
        assert (part.normals[part.faces].sum(axis=1) ** 2).sum(axis=1).min() > 1e-3
    painted = [p for p in vehicle.parts if p.material == "paint"]
    assert all(part.uvs is not None for part in painted)
    low = np.min([part.vertices.min(axis=0) for part in vehicle.parts], axis=0)
    high = np.max([part.vertices.max(axis=0) for part in vehicle.parts], axis=0)
    assert 2 < (high - low)[0] < 19
    assert (low[:2] < 0).all()
    assert (high[:2] > 0).all()
    if report.usable:
        assert not any("unwrap" in f.keys for f in report.findings if "paint_mask" in f.keys)


@each_mesh
def test_every_command_that_is_printed_is_one(path):
    """Its words are those of a command of ours; what it names exists."""
    for finding in check_vehicle(str(path), None).findings:
        for text in finding.mend.replace("or cnca", "cnca").split(";"):
            if not text.strip().startswith("cnca "):
                continue
            words = shlex.split(text)
            names = [command.name for command in app.registered_commands]
            assert words[1] in names
            assert any(Path(word).exists() for word in words[2:])


@needs_faults
@pytest.mark.parametrize("path", REFUSED, ids=lambda path: path.name)
def test_what_cannot_be_read_is_refused_by_name(path):
    with pytest.raises(MeshError, match=REFUSED[path]):
        read_meshes(path)


@needs_faults
@pytest.mark.parametrize(
    "name",
    ["uv_u8", "uv_u16", "quantized", "sparse", "my car", "nomat"],
)
def test_every_gltf_holds_the_same_car(name):
    """To the steps of its numbers."""
    right, other = (read_meshes(GLTF / f"{n}.gltf") for n in ("float", name))
    for mesh, same in zip(right.geometry.values(), other.geometry.values(), strict=True):
        node, twin = (next(iter(s.graph.geometry_nodes[k])) for s, k in
                      ((right, _key(right, mesh)), (other, _key(other, same))))  # fmt: skip
        moved = [s.graph[n][0] for s, n in ((right, node), (other, twin))]
        a, b = (m @ np.c_[v.vertices, np.ones(len(v.vertices))].T for m, v in
                zip(moved, (mesh, same), strict=True))  # fmt: skip
        np.testing.assert_allclose(a, b, atol=2e-3)
        np.testing.assert_allclose(mesh.visual.uv, same.visual.uv, atol=3e-3)


def _key(scene, mesh):
    return next(key for key, value in scene.geometry.items() if value is mesh)


@needs_faults
def test_the_wheel_arches_stay_open():
    """The area of both sides is that of their outlines by the shoelace formula."""
    path = FAULTS / "ngon-concave" / "ngon_sides.obj"
    rows = [line.split()[1:] for line in path.read_text().splitlines() if line.startswith("v ")]
    corners = np.array(rows, float)
    side = corners[np.isclose(corners[:, 2], 0.9)][:26, :2]
    x, y = side.T
    area = abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
    (mesh,) = read_meshes(path).geometry.values()
    flat = np.isclose(np.abs(mesh.face_normals[:, 2]), 1)
    assert mesh.area_faces[flat].sum() == pytest.approx(2 * area, rel=1e-3)


@needs_faults
def test_the_mask_counts_where_overlap_is_looked_for(tmp_path):
    """The wheels share texels outside the mask; nothing is proposed that would leave it behind."""
    report = check_vehicle(str(FAULTS / "unwrap-with-mask" / "scene.yaml"), tmp_path)
    assert report.usable
    assert not any("overlap" in finding.what for finding in report.findings)
    assert "unwrap" not in report.vehicle


@needs_faults
def test_a_vehicle_twelve_metres_off_is_that_of_the_origin():
    off, centred = (
        load_vehicle(FAULTS / "off-centre" / f"{name}.obj")
        for name in ("car_12m_off", "car_centred")
    )
    for part, same in zip(off.parts, centred.parts, strict=True):
        np.testing.assert_allclose(part.vertices, same.vertices, atol=1e-6)


@needs_faults
def test_names_in_gbk_stay_as_many_as_there_are():
    section = VehicleSection(mesh="gbk.obj")
    pieces = read_pieces(section, FAULTS / "material-names")
    assert len({piece.material for piece in pieces}) == len(pieces) == 3


@needs_faults
def test_what_looks_like_nothing_is_painted_last():
    """``MI_Interior`` has the largest area, all of it hidden."""
    kinds = {
        piece.material: piece.kind
        for name in ("paint-is-interior", "material-names")
        for piece in read_pieces(VehicleSection(mesh="car.obj"), FAULTS / name)
    }
    assert kinds["MI_Interior"] == kinds["seat_body"] == "trim"
    assert kinds["body_light_gray"] == "paint"


@pytest.mark.skipif(not WORLDS.exists(), reason="needs ../shared/data/worlds")
@pytest.mark.parametrize(
    "path",
    sorted(path for path in WORLDS.rglob("*") if path.suffix in ENDINGS),
    ids=lambda path: path.name,
)
def test_worlds_are_read(path):
    world = load_world(path)
    assert all(np.isfinite(piece.vertices).all() for piece in world.pieces)
    assert any(surface.texture is not None for surface in world.surfaces.values())
