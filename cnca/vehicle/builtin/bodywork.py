"""The closed outer skin of a car: cross-sections along a profile, rounded off at both ends.

A station at x has a half cross-section of straight lines with rounded corners: floor, sill, waist,
belt, roof corner, roof.  In plan and in height the sections shrink towards both ends along
superellipses (Lamé curves), which closes nose and tail smoothly; a shear of the two ends gives
the bumpers, the rake of the nose and the slope of a tail gate.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from cnca.vehicle.builtin.shapes import SedanShape
from cnca.vehicle.mesh.surface import Surface, grid_faces

Numbers = np.ndarray
"""Floats of any shape, or a single one; a function returns the shape that it takes."""

PLAN_EXPONENT = 6.5
"""Exponent of the outline seen from above; 2 is an ellipse, ∞ a rectangle."""
HEIGHT_EXPONENT = 22.0
"""Exponent of the outline seen from the side."""
END_HEIGHT = 0.99
"""Part of the height's superellipse that is used: 1 would bring nose and tail to a point."""
END_LIFT = 0.05
"""How much higher the floor is under nose and tail than between the wheels, metres."""
STATIONS = 80
COARSE_STATIONS = 32
ROOF_CROWN = 0.05
"""How much higher the roof is in the middle than at its corner, metres."""


@dataclass(frozen=True)
class Body:
    """The lines of a shape as functions of x, and the skin that they span.  Metres."""

    shape: SedanShape
    coarse: bool = False
    """About a sixth of the triangles, for vehicles that only pass by."""

    @property
    def nose(self) -> float:
        """x of the foremost point; the rearmost is its negative."""
        return self.shape.length / 2

    @property
    def cowl(self) -> float:
        """x of the windscreen's foot."""
        return self.nose - self.shape.bonnet_length

    @property
    def roof_front(self) -> float:
        """x of the windscreen's upper edge."""
        return self.cowl - self.shape.windscreen_run

    @property
    def deck(self) -> float:
        """x of the rear window's lower edge: the tail itself without a boot."""
        return -self.nose + self.shape.boot_length

    @property
    def roof_rear(self) -> float:
        """x of the rear window's upper edge."""
        return self.deck + self.shape.rear_window_run

    @property
    def axles(self) -> tuple[float, float]:
        """x of the front and the rear wheels' centres."""
        front = self.nose - self.shape.front_overhang
        return front, front - self.shape.wheelbase

    @property
    def waist(self) -> float:
        """Height of the widest line and of both bumpers."""
        return 0.5 * (self.shape.clearance + self.shape.nose_height) + 0.04

    @property
    def tail_top(self) -> float:
        """Height of the rear face's upper edge."""
        shrink = float(_lame(np.array(END_HEIGHT), HEIGHT_EXPONENT))
        return self.waist + shrink * (float(self.top(np.array(-self.nose))) - self.waist)

    @cached_property
    def _profile(self) -> Float[np.ndarray, "points 2"]:
        s = self.shape
        roof_middle = 0.55 * self.roof_front + 0.45 * self.roof_rear
        front = [
            (self.nose, s.nose_height),
            (self.nose - 0.45 * s.bonnet_length, 0.35 * s.nose_height + 0.65 * s.cowl_height),
            (self.cowl, s.cowl_height),
            (self.roof_front, s.height - 0.05),
            (roof_middle, s.height),
        ]
        if s.boot_length > 0:
            rear = [
                (self.roof_rear, s.height - 0.06),
                (self.deck, s.boot_height),
                (-self.nose, s.boot_height - 0.03),
            ]
        else:
            rear = [(-self.nose, s.height - 0.07)]
        radii = [0.35, 0.18, 0.25, 0.6] + [0.22, 0.16][: len(rear) - 1]
        knots = np.array(front + rear)[None]
        return rounded(knots, np.array(radii), [8] * (len(radii) + 1))[0, ::-1]

    def top(self, x: Numbers) -> Numbers:
        """Height of the middle line: bonnet, windscreen, roof, rear window, boot."""
        return np.interp(x, self._profile[:, 0], self._profile[:, 1])

    def belt(self, x: Numbers) -> Numbers:
        """Height of the shoulder, which stays 6 cm under the bonnet and the boot."""
        s = self.shape
        line = s.belt_height + s.belt_rise * (self.cowl - x) / (self.cowl + self.nose)
        return _soft_minimum(line, self.top(x) - 0.06, 0.02)

    def corner(self, x: Numbers) -> Numbers:
        """Half the width of the roof, or of the windscreen, at its upper corner."""
        lean = np.tan(np.radians(self.shape.tumblehome))
        rise = self.top(x) - ROOF_CROWN - self.belt(x)
        return self.plan(x) * (0.965 * self.shape.width / 2 - lean * np.maximum(rise, 0.0) - 0.02)

    def plan(self, x: Numbers) -> Numbers:
        """Half the width in units of its largest value."""
        return _lame(x / self.nose, PLAN_EXPONENT)

    def skin(self) -> Surface:
        """The closed surface, without openings."""
        x = self._stations()
        half = rounded(
            self._sections(x),
            np.array([0.04, 0.05, 0.30, 0.10, 0.12, 0.30]),
            [1, 1, 1, 2, 2, 1, 1] if self.coarse else [1, 1, 4, 5, 6, 3, 2],
            bend=2 if self.coarse else 5,
        )
        shrink = np.stack(
            [self.plan(x), _lame(END_HEIGHT * x / self.nose, HEIGHT_EXPONENT)], axis=-1
        )
        centre = np.array([0.0, self.waist])
        half = centre + (half - centre) * shrink[:, None]
        ring = np.concatenate([half, half[:, -2:0:-1] * np.array([-1.0, 1.0])], axis=1)
        stations = np.broadcast_to(x[:, None, None], (*ring.shape[:2], 1))
        vertices = np.concatenate([stations, ring], axis=-1).reshape(-1, 3)
        vertices[:, 0] = self._rake(vertices[:, 0], vertices[:, 2])
        return Surface.smooth(vertices, grid_faces(len(x), ring.shape[1]))

    def _stations(self) -> Numbers:
        """x of the sections from nose to tail, equally spaced along plan and profile."""
        x = self.nose * np.cos(np.linspace(0.0, np.pi, 4001))
        height = self.top(x) * _lame(END_HEIGHT * x / self.nose, HEIGHT_EXPONENT)
        line = np.stack([x, self.plan(x) * self.shape.width / 2, height], axis=1)
        run = np.append(0.0, np.linalg.norm(np.diff(line, axis=0), axis=1).cumsum())
        count = COARSE_STATIONS if self.coarse else STATIONS
        stations = np.interp(np.linspace(0.0, run[-1], count), run, x)
        # The plan's slope is infinite here: a rounding error in x would leave the ends open.
        stations[[0, -1]] = self.nose, -self.nose
        return stations

    def _sections(self, x: Numbers) -> Float[np.ndarray, "stations 8 2"]:
        """Corners (y, z) of the half-sections from the floor's middle to the roof's."""
        s = self.shape
        w, ones = s.width / 2, np.ones_like(x)
        belt, top = self.belt(x), self.top(x)
        floor = s.clearance + END_LIFT * _smooth_step((np.abs(x) - self.nose + 0.7) / 0.7)
        corner_y = self.corner(x) / np.maximum(self.plan(x), 1e-9)
        corner_z = np.maximum(top - ROOF_CROWN, belt + 0.02)
        lines = [
            (0.0 * ones, floor),
            (0.90 * w * ones, floor),
            (0.97 * w * ones, floor + 0.10),
            (w * ones, self.waist * ones + 0.10),
            (0.965 * w * ones, belt),
            (corner_y, corner_z),
            (0.35 * corner_y, top),
            (0.0 * ones, top),
        ]
        return np.stack([np.stack(line, axis=-1) for line in lines], axis=1)

    def _rake(self, x: Numbers, z: Numbers) -> Numbers:
        """Shear both ends lengthwise: setback of chin, bonnet edge and tail gate by height."""
        s = self.shape
        chin, bumper = s.clearance, self.waist
        front = np.interp(
            z, [chin, bumper - 0.05, bumper + 0.08, s.nose_height], [0.08, 0, 0.015, 0.11]
        )
        if s.boot_length > 0:
            knots, setback = [chin, bumper, bumper + 0.1, s.boot_height], [0.10, 0, 0.03, 0.06]
        else:
            belt = s.belt_height + s.belt_rise
            knots = [chin, bumper, bumper + 0.1, belt, s.height]
            setback = [0.10, 0.0, 0.03, 0.06, 0.06 + s.rear_window_run]
        rear = np.interp(z, knots, setback)
        reach = 0.75 + 1.2 * max(setback)
        return (
            x
            - front * _smooth_step((x - self.nose + 0.75) / 0.75)
            + rear * _smooth_step((reach - self.nose - x) / reach)
        )


def rounded(
    corners: Float[np.ndarray, "lines corners 2"],
    radii: Float[np.ndarray, " inner_corners"],
    samples: list[int],
    bend: int = 5,
) -> Float[np.ndarray, "lines points 2"]:
    """Polylines whose inner corners are rounded by parabolas (quadratic Bézier curves).

    A parabola starts and ends ``radii`` metres from its corner, or 0.45 of the shorter edge;
    ``samples`` counts the pieces into which each straight edge between two corners is cut, and
    ``bend`` those of each parabola.
    """
    edges = np.diff(corners, axis=1)
    length = np.maximum(np.linalg.norm(edges, axis=-1, keepdims=True), 1e-9)
    shorter = np.minimum(length[:, :-1], length[:, 1:])
    reach = np.minimum(radii[None, :, None], 0.45 * shorter)
    before = corners[:, 1:-1] - reach * (edges / length)[:, :-1]
    after = corners[:, 1:-1] + reach * (edges / length)[:, 1:]

    start = np.concatenate([corners[:, :1], after], axis=1)
    end = np.concatenate([before, corners[:, -1:]], axis=1)
    points = []
    for edge, pieces in enumerate(samples):
        t = np.linspace(0.0, 1.0, pieces + 1)[:, None]
        points.append((1 - t) * start[:, edge, None] + t * end[:, edge, None])
        if edge < len(samples) - 1:
            t = np.linspace(0.0, 1.0, bend + 1)[1:-1, None]
            points.append(
                (1 - t) ** 2 * before[:, edge, None]
                + 2 * t * (1 - t) * corners[:, edge + 1, None]
                + t**2 * after[:, edge, None]
            )
    return np.concatenate(points, axis=1)


def _lame(t: Numbers, exponent: float) -> Numbers:
    """Height of the Lamé curve |t|ⁿ + |h|ⁿ = 1 over t in [−1, 1]."""
    return np.maximum(1.0 - np.abs(t) ** exponent, 0.0) ** (1.0 / exponent)


def _soft_minimum(a: Numbers, b: Numbers, width: float) -> Numbers:
    """A minimum whose kink is rounded over ``width`` metres."""
    return 0.5 * (a + b - np.sqrt((a - b) ** 2 + width**2))


def _smooth_step(t: Numbers) -> Numbers:
    """0 below 0, 1 above 1, without a kink."""
    t = np.clip(t, 0.0, 1.0)
    return t * t * (3 - 2 * t)
