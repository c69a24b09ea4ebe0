"""The built-in worlds: whole meshes, places that are free, the same world for the same seed."""

import time

import numpy as np
import pytest

from cnca.core.errors import MeshError, SceneError
from cnca.detect.classes import COCO
from cnca.world.builtin import BUILTIN_WORLDS, build
from cnca.world.model import Place, World

MOST_TRIANGLES = 480_000


@pytest.fixture(scope="module", params=BUILTIN_WORLDS)
def world(request: pytest.FixtureRequest) -> World:
    return build(request.param, 0)


def test_every_mesh_is_whole(world: World):
    for piece in world.pieces:
        assert piece.vertices.shape == piece.normals.shape
        assert np.isfinite(piece.vertices).all()
        assert 0 <= piece.faces.min() <= piece.faces.max() < len(piece.vertices)
        np.testing.assert_allclose(np.linalg.norm(piece.normals, axis=1), 1.0, atol=1e-6)


def test_faces_turn_to_where_their_normals_point(world: World):
    for piece in world.pieces:
        a, b, c = (piece.vertices[piece.faces[:, corner]] for corner in range(3))
        across = np.cross(b - a, c - a)
        agrees = (across * piece.normals[piece.faces].mean(axis=1)).sum(axis=1)
        area = np.linalg.norm(across, axis=1)
        wrong = area[agrees < 0].sum() / max(area.sum(), 1e-12)
        # Leaves lean their normals; on a car's edges a sliver may disagree.
        assert wrong < 0.02, piece.name


def test_surfaces_are_used_and_within_what_materials_reflect(world: World):
    assert {piece.surface for piece in world.pieces} == set(world.surfaces)
    for piece in world.pieces:
        surface = world.surfaces[piece.surface]
        if surface.texture is not None:
            assert piece.uvs is not None
            assert piece.uvs.shape == (len(piece.vertices), 2)
            assert np.isfinite(piece.uvs).all()
            assert surface.texture.dtype == np.uint8
            assert max(surface.texture.shape) <= 1024
            linear = ((surface.texture / 255 + 0.055) / 1.055) ** 2.4 * surface.base_color
            assert linear.mean() < 0.75, piece.surface
        assert surface.glows == (piece.surface in ("pane", "display"))


def test_lamps_hang_over_the_road_or_belong_to_traffic(world: World):
    """Downwards from 6 m on, or level and low: two white and two red ones to a car that drives."""
    assert len(world.lamps) > 4
    for lamp in world.lamps:
        assert np.linalg.norm(lamp.direction) == pytest.approx(1)
        high = lamp.position[2] > 6.0
        assert (lamp.direction[2] < -0.99) == high
        assert high or 0.3 < lamp.position[2] < 1.5
    low = [lamp for lamp in world.lamps if lamp.position[2] < 2.0]
    beams = [lamp for lamp in low if lamp.beam]
    assert len(low) == 2 * len(beams)
    assert len(beams) % 2 == 0


def test_lamps_turn_with_their_world(world: World):
    moved = world.around(Place(3.0, -2.0, 0.0, 90.0))
    for lamp, other in zip(world.lamps, moved.lamps, strict=True):
        (x, y, _), (a, b, _) = lamp.position, other.position
        assert (a, b) == pytest.approx((y + 2.0, 3.0 - x))
        assert other.direction[:2] == pytest.approx((lamp.direction[1], -lamp.direction[0]))


def test_labels_are_those_of_coco_and_pieces_belong_to_one_object(world: World):
    used = [index for thing in world.objects for index in thing.pieces]
    assert len(used) == len(set(used))
    assert {thing.label for thing in world.objects} <= set(COCO)
    assert sum(thing.label == "car" for thing in world.objects) >= 3


def test_vehicles_stand_on_the_ground(world: World):
    for thing in world.objects:
        if thing.label in ("car", "truck"):
            low = min(world.pieces[index].vertices[:, 2].min() for index in thing.pieces)
            assert -0.02 <= low <= 0.02


def test_places_are_on_free_road(world: World):
    assert len(world.places) >= 8
    for place in world.places:
        assert not _blocked(world, place)


def _blocked(world: World, place: Place) -> bool:
    """Whether anything lies in the box that a car of 5 × 2 × 1.6 m takes, bar the road itself."""
    around = World(world.name, world.pieces, {}).around(place)
    for piece in around.pieces:
        centres = piece.vertices[piece.faces].mean(axis=1)
        points = np.concatenate([piece.vertices, centres])
        inside = (np.abs(points[:, 0]) < 2.5) & (np.abs(points[:, 1]) < 1.0)
        if (inside & (points[:, 2] > 0.05) & (points[:, 2] < 1.6)).any():
            return True
    return False


def test_the_usual_place_has_a_free_view(world: World):
    """Nothing from 1 to 6 m high stands within 6 m of the usual place; lamps hang higher."""
    around = World(world.name, world.pieces, {}).around(world.places[0])
    for piece in around.pieces:
        near = np.hypot(piece.vertices[:, 0], piece.vertices[:, 1]) < 6.0
        high = (piece.vertices[:, 2] > 1.0) & (piece.vertices[:, 2] < 6.0)
        assert not (near & high).any(), piece.name


@pytest.mark.parametrize("name", BUILTIN_WORLDS)
def test_the_seed_decides(name: str):
    first, again, other = build(name, 3), build(name, 3), build(name, 4)
    assert first.places == again.places
    assert len(first.pieces) == len(again.pieces)
    for piece, same in zip(first.pieces, again.pieces, strict=True):
        np.testing.assert_array_equal(piece.vertices, same.vertices)
        assert piece.name == same.name
    counts = [sum(len(piece.vertices) for piece in world.pieces) for world in (first, other)]
    assert counts[0] != counts[1]


@pytest.mark.parametrize("name", BUILTIN_WORLDS)
def test_a_world_is_small_and_soon_built(name: str):
    build(name, 0)  # pictures are painted once for each process
    start = time.process_time()
    world = build(name, 1)
    assert time.process_time() - start < 2.0
    assert sum(len(piece.faces) for piece in world.pieces) < MOST_TRIANGLES
    texels = {
        id(s.texture): s.texture.size for s in world.surfaces.values() if s.texture is not None
    }
    assert sum(texels.values()) < 3 * 8 * 2**20


def test_an_unknown_name_gets_the_nearest():
    with pytest.raises(MeshError, match="did you mean 'street'"):
        build("stret", 0)
    with pytest.raises(SceneError, match="seed -1"):
        build("street", -1)
