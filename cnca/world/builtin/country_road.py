"""``builtin:country_road``: a winding road between fields, hedges and woods."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np

from cnca.world.builtin.furniture import traffic_sign
from cnca.world.builtin.houses import draw_style, house
from cnca.world.builtin.meshes import Mesh, box, merge, quads, rectangle, tube
from cnca.world.builtin.plants import bush, tree, tussocks
from cnca.world.builtin.roads import PIECE, dashes, lane, line, repairs
from cnca.world.builtin.site import Pose, Site
from cnca.world.builtin.traffic import put_vehicle
from cnca.world.model import Place, World

REACH = 260.0
"""Half the road's length, metres."""
WIDTH = 3.1
"""Width of a lane, metres."""
SHOULDER = WIDTH + 0.9
LEVEL = 10.0
"""Distance from the road's middle up to which the ground is level, metres."""
CELL = 6.0
"""Size of the terrain's cells, metres."""


class Course:
    """Where the road runs: straight around x = 0, then curves of about 300 m radius."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._bends = rng.choice([-1.0, 1.0], 2) * rng.uniform(250.0, 420.0, 2)
        self._straight = 30.0

    def y(self, x: np.ndarray | float) -> np.ndarray:
        """The road's middle at x."""
        beyond = np.maximum(np.abs(x) - self._straight, 0.0)
        radius = np.where(np.asarray(x) > 0, self._bends[0], self._bends[1])
        return beyond**2 / (2 * radius)

    def pose(self, x: float, away: float, turn: float = 0.0, up: float = 0.0) -> Pose:
        """Axes along the road, ``away`` metres to the left of its middle."""
        slope = float(self.y(x + 0.5) - self.y(x - 0.5))
        foot = Pose(x, float(self.y(x)), math.degrees(math.atan(slope)))
        return foot.then(0.0, away, turn, up)

    def bent(self, mesh: Mesh) -> Mesh:
        """What was made along x, moved over to the road."""
        shift = np.zeros_like(mesh.vertices)
        shift[:, 1] = self.y(mesh.vertices[:, 0])
        return Mesh(mesh.vertices + shift, mesh.faces, mesh.normals, mesh.uvs)


def build(rng: np.random.Generator) -> World:
    """The usual place stands in the right lane of the straight stretch."""
    site, course = Site(), Course(rng)
    terrain = Terrain(rng, course)
    _road(site, rng, course)
    terrain.add(site)
    _verges(site, rng, course)
    for side in (-1.0, 1.0):
        _trees(site, rng, course, terrain, side)
        _poles(site, course, side)
    for x in rng.uniform(60.0, 120.0, 2) * [1.0, -1.0]:
        side = float(rng.choice([-1.0, 1.0]))
        farm = course.pose(float(x), side * 24.0, 0.0 if side > 0 else 180.0)
        style = replace(draw_style(rng), storeys=1, balconies=False)
        house(site, rng, farm, style, 14.0, shop=False, corners=(True, True))
    for lane_y, turn in ((-WIDTH / 2, 0.0), (WIDTH / 2, 180.0)):
        for x in np.concatenate([rng.uniform(20.0, 34.0, 1), rng.uniform(50.0, 150.0, 2)]):
            for direction in (-1.0, 1.0):
                put_vehicle(site, rng, course.pose(float(direction * x), lane_y, turn), drives=True)
    return site.world("builtin:country_road", _places(site, course))


def _road(site: Site, rng: np.random.Generator, course: Course) -> None:
    origin = Pose()
    for start in np.arange(-REACH, REACH, PIECE):
        x = (float(start), float(min(start + PIECE, REACH)))
        for y in ((-WIDTH, 0.0), (0.0, WIDTH)):
            site.add("asphalt", course.bent(lane(rng, x, y)), origin)
        for edge in (-WIDTH + 0.15, WIDTH - 0.15):
            site.add("marking", course.bent(line(rng, x, edge)), origin)
        for y in ((-SHOULDER, -WIDTH), (WIDTH, SHOULDER)):
            site.add("gravel", course.bent(rectangle(x, y, -0.01)), origin)
    site.add("marking", course.bent(dashes(rng, (-REACH + 3, REACH - 3), 0.0)), origin)
    repairs(site, rng, origin, (-28.0, 28.0), (-WIDTH + 0.3, WIDTH - 0.3))


class Terrain:
    """Ground that is level along the road and rolls away from it."""

    def __init__(self, rng: np.random.Generator, course: Course) -> None:
        self._course = course
        self._waves = rng.uniform(-1, 1, (8, 3)) * [0.035, 0.035, np.pi]
        self._parcels = rng.random((40, 40))

    def height(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Metres above the road."""
        away = np.maximum(np.abs(y - self._course.y(x)) - LEVEL, 0.0)
        roll = sum(np.sin(a * x + b * y + c) for a, b, c in self._waves) / 4
        rise = 9.0 * (1 - np.exp(-away / 120.0)) + 5.0 * np.tanh(away / 90.0) * roll
        return rise - 0.05 - 0.25 * np.exp(-((away - 2.0) ** 2)) * (away > 0)

    def add(self, site: Site) -> None:
        """Cells of grass beside the road, and of one crop for each parcel beyond."""
        x, y = np.meshgrid(np.arange(-60, 61) * CELL, np.arange(-42, 43) * CELL, indexing="ij")
        grid = np.stack([x, y, self.height(x, y)], axis=-1)
        corners = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], axis=2)
        middle = corners.mean(axis=2)
        away = np.abs(middle[..., 1] - self._course.y(middle[..., 0]))
        parcel = self._parcels[
            (middle[..., 0] // 70).astype(int) % 40, (middle[..., 1] // 48).astype(int) % 40
        ]
        crop = np.where(away < 22.0, 0, np.where(parcel < 0.4, 0, np.where(parcel < 0.75, 1, 2)))
        for number, surface in enumerate(("grass", "field", "soil")):
            chosen = corners[crop == number].reshape(-1, 4, 3)
            if len(chosen):
                mesh = quads(chosen, chosen[..., :2])
                site.add(surface, self._smooth(mesh), Pose())

    def _smooth(self, mesh: Mesh) -> Mesh:
        x, y, _ = mesh.vertices.T
        slope_x = self.height(x + 0.5, y) - self.height(x - 0.5, y)
        slope_y = self.height(x, y + 0.5) - self.height(x, y - 0.5)
        normals = np.stack([-slope_x, -slope_y, np.ones_like(x)], axis=-1)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return Mesh(mesh.vertices, mesh.faces, normals, mesh.uvs)


def _verges(site: Site, rng: np.random.Generator, course: Course) -> None:
    """Tall grass, white posts with a black band, a few signs."""
    for side in (-1.0, 1.0):
        x = rng.normal(0.0, 22.0, 1500)
        away = side * (SHOULDER + 0.1 + 5.0 * rng.random(1500) ** 1.5)
        site.add("leaves_light", tussocks(np.stack([x, course.y(x) + away], axis=-1), rng), Pose())
        posts, bands = [], []
        for at in np.arange(-200.0, 201.0, 25.0):
            if abs(at) < 8.0:
                continue
            spot = course.pose(float(at) + 6.0, side * (SHOULDER + 0.25))
            posts.append(box((-0.04, -0.06, -0.1), (0.04, 0.06, 0.95)).placed(spot.x, spot.y))
            band = box((-0.042, -0.062, 0.68), (0.042, 0.062, 0.86), sides="-x+x-y+y")
            bands.append(band.placed(spot.x, spot.y))
        site.add("frame_white", merge(posts), Pose())
        site.add("steel_dark", merge(bands), Pose())
    traffic_sign(site, course.pose(38.0, -SHOULDER - 0.9, -90.0), "speed")
    traffic_sign(site, course.pose(-46.0, SHOULDER + 0.9, 90.0), "speed")


def _trees(
    site: Site, rng: np.random.Generator, course: Course, terrain: Terrain, side: float
) -> None:
    """A loose row along the road, which is open at the usual place, and woods further away."""
    x = float(-220.0 + rng.uniform(0, 12))
    while x < 220.0:
        if abs(x) > 19.0:
            _plant(site, rng, course, terrain, x, side * float(rng.uniform(9.0, 13.0)))
        x += float(rng.uniform(9.0, 26.0))
    for _ in range(4):
        middle, deep = float(rng.uniform(-200, 200)), float(rng.uniform(55.0, 110.0))
        for _ in range(11):
            at, away = middle + rng.normal(0, 13.0), deep + abs(rng.normal(0, 9.0))
            _plant(site, rng, course, terrain, float(at), side * float(away))
    for end in (-REACH - 6.0, REACH + 6.0):
        for away in np.arange(2.0, 40.0, 5.0):
            _plant(site, rng, course, terrain, end + float(rng.normal(0, 3.0)), side * float(away))


def _plant(
    site: Site,
    rng: np.random.Generator,
    course: Course,
    terrain: Terrain,
    x: float,
    away: float,
) -> None:
    spot = course.pose(x, away)
    up = float(terrain.height(np.array(spot.x), np.array(spot.y)))
    if rng.random() < 0.75:
        tree(site, rng, spot.then(0, 0, up=up), float(rng.uniform(0.8, 1.4)))
    else:
        bush(site, rng, spot.then(0, 0, up=up), float(rng.uniform(0.7, 1.3)))


def _poles(site: Site, course: Course, side: float) -> None:
    """A line of wooden poles with a wire, on one side only."""
    if side < 0:
        return
    tops = []
    for x in np.arange(-210.0, 211.0, 42.0):
        spot = course.pose(float(x) + 21.0, 15.5)
        foot = np.array([[spot.x, spot.y, -0.3], [spot.x, spot.y, 7.5]])
        site.add("bark", tube(foot, np.array([0.13, 0.10]), 8), Pose())
        tops.append([spot.x, spot.y, 7.4])
    for a, b in itertools.pairwise(tops):
        t = np.linspace(0, 1, 9)[:, None]
        wire = (1 - t) * np.array(a) + t * np.array(b) - 2.8 * t * (1 - t) * [[0.0, 0.0, 1.0]]
        site.add("steel_dark", tube(wire, np.full(9, 0.015), 4), Pose())


def _places(site: Site, course: Course) -> list[Place]:
    places = [Place(0.0, -WIDTH / 2)]
    for x in np.arange(-120.0, 121.0, 8.0):
        for away, turn in ((-WIDTH / 2, 0.0), (WIDTH / 2, 180.0)):
            spot = course.pose(float(x), away, turn)
            place = Place(spot.x, spot.y, 0.0, spot.heading)
            if site.free(place, 8.5) and abs(x) > 4.0:
                places.append(place)
    return places
