"""Views, weathers and places that runs draw from a scene's world."""

import numpy as np
import pytest

from cnca.core.errors import SceneError
from cnca.scene.cameras import Spot, orbit_view
from cnca.scene.schema import Scene
from cnca.scene.variation import draw_spots, draw_views, draw_weathers, in_blocks
from cnca.world import draw, resolve
from cnca.world.draw import draw_blocks
from cnca.world.model import Piece, Place, Surface, World
from cnca.world.sight import Sight


def wall(x: float, half: float = 20.0) -> Piece:
    corners = np.array([[x, -half, 0], [x, half, 0], [x, half, 9], [x, -half, 9.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return Piece("wall", "brick", corners, faces, np.tile([1.0, 0, 0], (4, 1)))


def walled(*xs: float) -> World:
    return World("walled", tuple(map(wall, xs)), {"brick": Surface()}, ground=True)


def view(azimuth: float, distance: float = 8.0):
    return orbit_view(azimuth, 10, distance, fov=45, width=8, height=8)


@pytest.fixture
def street(monkeypatch):
    """A world whose places 0 and 1 have a wall 3 m ahead and behind."""

    def make(section, base, seed=0):
        usual = Place(0.0, 0.0)
        places = (usual, usual, Place(0.0, 0.0, heading=180.0))
        return World("walled", (wall(3.0),), {"brick": Surface()}, places=places, ground=True)

    monkeypatch.setattr(resolve, "resolve_world", make)
    return Scene(world="builtin:street")


def test_what_stands_in_front_hides_and_what_stands_behind_does_not():
    sight = Sight(walled(5.0))
    assert sight.share(view(0)) == 0.0
    assert sight.share(view(180)) == 1.0
    assert sight.share(view(90)) == 1.0


def test_half_a_wall_hides_half():
    corners = np.array([[5, 0.01, 0], [5, 9, 0], [5, 9, 9], [5, 0.01, 9.0]])
    piece = Piece("half", "brick", corners, np.array([[0, 1, 2], [0, 2, 3]]), np.zeros((4, 3)))
    share = Sight(World("half", (piece,), {"brick": Surface()})).share(view(0, 20.0))
    assert share == pytest.approx(2 / 3)  # one of three columns of points lies behind it


def test_without_a_world_views_are_drawn_as_ever():
    scene = Scene()
    views, weathers = draw_blocks(scene, 12, 3, seed=5)
    assert views == in_blocks(draw_views(scene, 12, seed=5), 3)
    assert weathers == draw_weathers(scene, 3, seed=5)


def test_views_that_a_wall_hides_are_drawn_again(street):
    views, weathers = draw_blocks(street, 32, 4, seed=1)
    assert [len(block) for block in views] == [8] * 4
    for block in views:
        (spot,) = {view.spot for view in block}
        sight = Sight(resolve.world_at(street.world, street.base, spot))
        assert min(sight.share(view) for view in block) >= draw.LEAST_SHARE
    assert draw_blocks(street, 32, 4, seed=1) == (views, weathers)


def test_a_vehicle_between_walls_on_all_sides_is_an_error(street, monkeypatch):
    monkeypatch.setattr(draw, "LEAST_SHARE", 1.1)
    with pytest.raises(SceneError, match="nobody sees the vehicle"):
        draw_blocks(street, 4, 2, seed=1)


def test_spots_are_other_worlds_for_another_seed():
    scene = Scene(world="builtin:street", variation={"worlds": 3, "places": 2})
    first, second = draw_spots(scene, seed=0), draw_spots(scene, seed=104_729)
    assert len(set(first)) == 6
    assert len({spot.seed for spot in first}) == 3
    assert not {spot.seed for spot in first} & {spot.seed for spot in second}


def test_no_places_to_draw_are_the_scenes_own():
    scene = Scene(world="builtin:street", variation={"places": 0})
    assert draw_spots(scene, seed=0) == [Spot()]
