"""Meshes with one fault each: it is found, its number is right, and its remedy mends it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from cnca.core.errors import MeshError
from cnca.scene.schema import VehicleSection
from cnca.vehicle.builtin.sedan import BUILTIN_VEHICLES
from cnca.vehicle.mesh.checkup import check, mended
from cnca.vehicle.mesh.load_mesh import load_vehicle
from cnca.vehicle.mesh.write_mesh import write_obj
from cnca.vehicle.model import Vehicle

CAR = Path(__file__).parents[3] / "scenes/hard/meshes/car.obj"
"""4 × 1.8 × 1.5 m, thirty triangles: paint, glass and tyres, up z."""
SHARED = Path(__file__).parents[3] / "../shared/data"
ASAM = SHARED / "vehicles/asam_vehicle/vehicle_example.gltf"
OURS = {"up": "z"}


def _car(**changes) -> Vehicle:
    """The car, its painted part with other arrays."""
    car = load_vehicle(CAR, up="z")
    parts = [replace(p, **changes) if p.material == "paint" else p for p in car.parts]
    return replace(car, parts=tuple(parts))


def _paint():
    return next(part for part in load_vehicle(CAR, up="z").parts if part.material == "paint")


def _section(tmp_path, vehicle, **keys) -> VehicleSection:
    write_obj(tmp_path / "car.obj", vehicle)
    return VehicleSection(mesh="car.obj", **(OURS | keys))


def _lines(section, base, severities=("fault", "warning")):
    """What is said, save that this car has no lights."""
    found = [one for one in check(section, base) if one.severity in severities]
    return [one.line() for one in found if "none is known as light" not in one.number]


def _mended(section, base):
    return mended(section, check(section, base))


def _turned(vehicle: Vehicle, matrix) -> Vehicle:
    return replace(
        vehicle,
        parts=tuple(
            replace(p, vertices=p.vertices @ matrix.T, normals=p.normals @ matrix.T)
            for p in vehicle.parts
        ),
    )


def test_a_good_car_has_no_faults(tmp_path):
    assert _lines(_section(tmp_path, _car()), tmp_path) == []


@pytest.mark.parametrize("name", BUILTIN_VEHICLES)
def test_builtin_vehicles_are_good(name):
    assert _lines(VehicleSection(mesh=f"builtin:{name}"), Path(".")) == []


@pytest.mark.parametrize(
    ("per_metre", "unit"), [(1000, "millimetres"), (100, "centimetres"), (1 / 0.0254, "inches")]
)
def test_another_unit_is_named_and_mended(tmp_path, per_metre, unit):
    section = _section(tmp_path, _turned(_car(), per_metre * np.eye(3)))
    (line,) = _lines(section, tmp_path)
    assert line.startswith("fault   size: ")
    assert line.endswith(unit)
    better = _mended(section, tmp_path)
    assert better.scale == pytest.approx(1 / per_metre)
    assert _lines(better, tmp_path) == []


@pytest.mark.parametrize(("stem", "label"), [("bus", "bus"), ("my_truck_2", "truck")])
@pytest.mark.parametrize("per_metre", [1, 100])
def test_buses_and_trucks_keep_their_length(tmp_path, stem, label, per_metre):
    """12 × 2.5 × 3.2 m, in metres and in centimetres; the name says what it is."""
    long = np.diag([3.0, 1.4, 2.1]) * per_metre
    write_obj(tmp_path / f"{stem}.obj", _turned(_car(), long))
    section = VehicleSection(mesh=f"{stem}.obj", up="z")
    better = _mended(section, tmp_path)
    assert better.scale == pytest.approx(1 / per_metre)
    assert better.label == label
    assert not any("size" in line for line in _lines(better, tmp_path))


def test_a_place_away_from_the_origin_is_said(tmp_path):
    car = _car()
    parts = tuple(replace(p, vertices=p.vertices + (12.0, 0, 0)) for p in car.parts)
    section = _section(tmp_path, replace(car, parts=parts))
    assert any("12 m from the origin" in line for line in _lines(section, tmp_path, ("note",)))
    kept = section.model_copy(update={"recentre": False})
    assert _mended(kept, tmp_path).recentre


AXES = {
    ("y", "+x"): [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    ("y", "-z"): [[0, -1, 0], [0, 0, 1], [-1, 0, 0]],
    ("x", "+y"): [[0, 0, 1], [1, 0, 0], [0, 1, 0]],
    ("z", "-x"): [[-1, 0, 0], [0, -1, 0], [0, 0, 1]],
}
"""Up and front of the file → from our axes to the file's: rotations, worked out by hand."""


@pytest.mark.parametrize("axes", AXES)
def test_other_axes_are_found_from_the_shape(tmp_path, axes):
    matrix = np.array(AXES[axes])
    assert np.linalg.det(matrix) == 1
    section = _section(tmp_path, _turned(_car(), matrix))
    (line,) = _lines(section, tmp_path)
    assert " axes: " in line
    better = _mended(section, tmp_path)
    assert (better.up, better.front) == axes
    assert _lines(better, tmp_path) == []
    turned = load_vehicle(tmp_path / "car.obj", up=better.up, front=better.front)
    was = {part.material: part.vertices for part in load_vehicle(CAR, up="z").parts}
    for part in turned.parts:
        np.testing.assert_allclose(part.vertices, was[part.material], atol=1e-6)


def test_upside_down_is_no_matter_of_keys(tmp_path):
    over = np.diag([1.0, -1.0, -1.0])
    (line,) = _lines(_section(tmp_path, _turned(_car(), over)), tmp_path)
    assert line.startswith("fault   axes: upside down")


def test_missing_uvs(tmp_path):
    section = _section(tmp_path, _car(uvs=None))
    assert _lines(section, tmp_path) == ["fault   UVs: paint have none → vehicle.unwrap: true"]
    assert _lines(_mended(section, tmp_path), tmp_path) == []


def test_uvs_outside(tmp_path):
    section = _section(tmp_path, _car(uvs=_paint().uvs + 0.4))
    line = _lines(section, tmp_path)[0]
    assert line.startswith("fault   UVs: paint leave [0, 1]")
    assert _lines(_mended(section, tmp_path), tmp_path) == []


def test_overlapping_uvs_are_counted(tmp_path):
    """All painted faces twice, the second time 10 m farther back: half of the use is double."""
    car, paint = _car(), _paint()
    again = replace(paint, vertices=paint.vertices - (10.0, 0, 0), name="again")
    section = _section(tmp_path, replace(car, parts=(*car.parts, again)))
    lines = [line for line in _lines(section, tmp_path) if "overlap" in line]
    share = float(lines[0].split(": ")[1].split("%")[0])
    # OpenCV draws borders half a texel too wide, on a raster of 4096.
    assert share == pytest.approx(50, abs=1)
    assert not any("overlap" in line for line in _lines(_mended(section, tmp_path), tmp_path))


def test_mirrored_uvs_are_counted(tmp_path):
    section = _section(tmp_path, _car(uvs=_paint().uvs * (-1, 1) + (1, 0)))
    (line,) = _lines(section, tmp_path)
    assert line.startswith("warning UVs mirrored: 100.0%")


def test_uvs_on_one_point(tmp_path):
    section = _section(tmp_path, _car(uvs=np.full_like(_paint().uvs, 0.5)))
    (line,) = _lines(section, tmp_path)
    assert line.startswith("fault   UVs: 100.0% of the paint lies on points")
    assert _lines(_mended(section, tmp_path), tmp_path) == []


def test_uneven_uvs(tmp_path):
    """One side of the car ten times smaller in the texture than the other."""
    uvs, small = _paint().uvs, _paint().vertices[:, 1] > 0.8
    section = _section(tmp_path, _car(uvs=np.where(small[:, None], 0.1 * uvs, uvs)))
    assert any(line.startswith("warning UVs uneven") for line in _lines(section, tmp_path))


def test_inverted_normals(tmp_path):
    section = _section(tmp_path, _car(normals=-_paint().normals))
    (line,) = _lines(section, tmp_path)
    area = {p.name: trimesh.Trimesh(p.vertices, p.faces).area for p in _car().parts}
    assert f"{area['paint'] / sum(area.values()):.1%} of the area" in line


def test_inside_out(tmp_path):
    car = _car()
    parts = tuple(replace(p, faces=p.faces[:, ::-1], normals=-p.normals) for p in car.parts)
    lines = _lines(_section(tmp_path, replace(car, parts=parts)), tmp_path)
    assert any(line.startswith("warning inside out: 9") for line in lines)


def test_missing_normals_and_flat_triangles_are_notes(tmp_path):
    section = _section(tmp_path, _car(faces=np.concatenate([_paint().faces, [[0, 0, 1]]])))
    text = (tmp_path / "car.obj").read_text()
    kept = [line for line in text.splitlines() if not line.startswith("vn ")]
    (tmp_path / "car.obj").write_text("\n".join(_without_normals(line) for line in kept))
    notes = _lines(section, tmp_path, severities=("note",))
    assert "note    normals: 3 of 3 parts have none → smooth ones are made" in notes
    assert any(note.startswith("note    triangles: 1 of 31 in 3 parts") for note in notes)


def _without_normals(line: str) -> str:
    if not line.startswith("f "):
        return line
    corners = [corner.split("/")[:2] for corner in line.split()[1:]]
    return "f " + " ".join("/".join(filter(None, corner)) for corner in corners)


def test_vertices_that_are_no_numbers(tmp_path):
    broken = _paint().vertices.copy()
    broken[0, 0] = np.nan
    (line,) = _lines(_section(tmp_path, _car(vertices=broken)), tmp_path, ("fault",))
    assert line == "fault   vertices: 1 vertices are NaN or infinite → export the mesh again"


def test_a_part_without_area(tmp_path):
    section = _section(tmp_path, _car(vertices=np.zeros_like(_paint().vertices)))
    assert any("without any area (paint)" in line for line in _lines(section, tmp_path))


def test_names_of_materials_and_parts(tmp_path):
    """Where materials' names say nothing, those of the parts do, and the largest is the body."""
    scene = trimesh.Scene()
    names = {"paint": ("m1", "shell"), "glass": ("m2", "Windscreen"), "tyre": ("m3", "Tire_FL")}
    for part in _car().parts:
        material, name = names[part.material]
        look = trimesh.visual.TextureVisuals(
            part.uvs, material=trimesh.visual.material.PBRMaterial(name=material)
        )
        mesh = trimesh.Trimesh(part.vertices, part.faces, visual=look, process=False)
        scene.add_geometry(mesh, node_name=name, geom_name=name)
    scene.export(tmp_path / "car.glb")
    section = VehicleSection(mesh="car.glb", up="z")
    assert any("is paint; most of it is m1" in line for line in _lines(section, tmp_path))
    better = _mended(section, tmp_path)
    assert better.materials == {"m1": "paint", "m2": "glass", "m3": "tyre"}
    assert _lines(better, tmp_path) == []


def test_one_material_asks_for_a_mask(tmp_path):
    car = _car()
    parts = tuple(p for p in car.parts if p.material == "paint")
    lines = _lines(_section(tmp_path, replace(car, parts=parts)), tmp_path)
    assert any("draw a vehicle.paint_mask" in line for line in lines)


def test_a_file_that_cannot_be_read_is_an_error(tmp_path):
    with pytest.raises(MeshError, match="no such file"):
        check(VehicleSection(mesh="none.obj"), tmp_path)


def test_the_gltf_vehicle_is_usable_once_mended():
    if not ASAM.exists():
        pytest.skip("needs the glTF vehicle in ../shared/data/vehicles/asam_vehicle")
    section = VehicleSection(mesh=ASAM.name)
    faults = _lines(section, ASAM.parent, ("fault",))
    assert [line[:45] for line in faults] == ["fault   UVs: Body leave [0, 1]: they span [-0"]
    assert _lines(_mended(section, ASAM.parent), ASAM.parent, ("fault",)) == []
