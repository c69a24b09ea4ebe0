"""Every built-in vehicle is a sound mesh of the size that was asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree

from cnca.scene.materials import MATERIALS
from cnca.vehicle.builtin.bodywork import Body
from cnca.vehicle.builtin.sedan import BUILTIN_VEHICLES, SedanShape, build_sedan
from cnca.vehicle.builtin.wheels import cut_wells
from cnca.vehicle.mesh.surface import face_crosses
from cnca.vehicle.model import Vehicle


@pytest.fixture(scope="module", params=sorted(BUILTIN_VEHICLES))
def built(request) -> tuple[SedanShape, Vehicle]:
    shape = BUILTIN_VEHICLES[request.param]
    return shape, build_sedan(shape)


def everything(vehicle: Vehicle) -> np.ndarray:
    return np.concatenate([part.vertices for part in vehicle.parts])


def test_size_and_place(built):
    shape, vehicle = built
    low, high = everything(vehicle).min(axis=0), everything(vehicle).max(axis=0)
    assert low[2] == pytest.approx(0.0, abs=1e-6)
    assert high[2] == pytest.approx(shape.height, abs=0.03)
    assert high[0] - low[0] == pytest.approx(shape.length, abs=0.03)
    assert low[:2] == pytest.approx(-high[:2], abs=0.02)
    # Mirrors stand out by some 12 cm on each side.
    assert shape.width < high[1] - low[1] < shape.width + 0.35


def test_parts_are_sound(built):
    _, vehicle = built
    assert {"paint", "glass", "tyre", "metal", "light", "tail_light", "plate", "trim"} <= {
        part.material for part in vehicle.parts
    }
    for part in vehicle.parts:
        assert part.material in MATERIALS
        assert len(part.faces) > 0
        assert np.isfinite(part.vertices).all()
        assert part.faces.min() >= 0
        assert part.faces.max() < len(part.vertices)
        assert np.linalg.norm(part.normals, axis=1) == pytest.approx(1.0, abs=1e-6)
        assert (part.uvs is not None) == (part.material == "paint")
    assert 5_000 < sum(len(part.faces) for part in vehicle.parts) < 40_000


def test_shading_normals_agree_with_the_winding(built):
    _, vehicle = built
    for part in vehicle.parts:
        crosses = face_crosses(part.vertices, part.faces)
        shading = part.normals[part.faces].sum(axis=1)
        agree = (crosses * shading).sum(axis=1)
        area = np.linalg.norm(crosses, axis=1)
        assert area[agree < 0].sum() < 1e-3 * area.sum(), part.name


def test_paint_and_glass_look_outwards(built):
    """From each point of the outer skin a ray along its normal leaves the vehicle's middle."""
    shape, vehicle = built
    for part in vehicle.parts:
        if part.material not in ("paint", "glass"):
            continue
        middle = part.vertices[part.faces].mean(axis=1)
        crosses = face_crosses(part.vertices, part.faces)
        # Seen from an axis along the car, at the height of the belt, the skin is star-shaped.
        spine = np.clip(middle[:, 0], -0.3 * shape.length, 0.3 * shape.length)
        from_spine = middle - np.stack(
            [spine, 0 * spine, np.full_like(spine, 0.6 * shape.belt_height)], axis=1
        )
        outward = (crosses * from_spine).sum(axis=1) > 0
        area = np.linalg.norm(crosses, axis=1)
        assert area[outward].sum() > 0.995 * area.sum(), part.name


@pytest.mark.parametrize("name", sorted(BUILTIN_VEHICLES))
def test_skin_with_wheel_wells_is_closed(name):
    body = Body(BUILTIN_VEHICLES[name])
    skin, wells = cut_wells(body.skin(), body)
    mesh = trimesh.util.concatenate(
        [trimesh.Trimesh(s.vertices, s.faces, process=False) for s in (skin, wells)]
    )
    mesh.merge_vertices(digits_vertex=6)
    edges, counts = np.unique(np.sort(mesh.edges, axis=1), axis=0, return_counts=True)
    open_length = np.linalg.norm(np.diff(mesh.vertices[edges[counts == 1]], axis=1), axis=-1).sum()
    assert open_length < 1e-4
    assert 0.3 < mesh.volume / (body.shape.length * body.shape.width * body.shape.height) < 0.8


def test_wheels_turn_inside_their_wells():
    """No tyre reaches through the body: the arch is wider than the tyre, the well deeper."""
    vehicle = build_sedan()
    body = Body(SedanShape())
    tyre = next(part for part in vehicle.parts if part.material == "tyre")
    paint = next(part for part in vehicle.parts if part.material == "paint")
    for axle in body.axles:
        distance = np.hypot(paint.vertices[:, 0] - axle, paint.vertices[:, 2] - 0.335)
        # Straight edges between points of the arch cut a little inside its circle.
        assert distance.min() > SedanShape().wheel_radius + 0.04
    assert np.abs(tyre.vertices[:, 1]).max() < SedanShape().width / 2


@pytest.mark.parametrize("name", sorted(BUILTIN_VEHICLES))
def test_left_and_right_are_mirror_images(name):
    points = Body(BUILTIN_VEHICLES[name]).skin().vertices
    distance, _ = KDTree(points).query(points * (1.0, -1.0, 1.0))
    assert distance.max() < 1e-5


def test_same_shape_same_vehicle():
    first, second = build_sedan(), build_sedan()
    for a, b in zip(first.parts, second.parts, strict=True):
        assert np.array_equal(a.vertices, b.vertices)
        assert np.array_equal(a.faces, b.faces)


def test_shape_can_be_changed():
    longer = build_sedan(replace(SedanShape(), length=5.1, wheelbase=3.1))
    assert np.ptp(everything(longer)[:, 0]) == pytest.approx(5.1, abs=0.03)
