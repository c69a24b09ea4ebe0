"""Where the cameras stand.  Right-handed axes: +x the vehicle's front, +y its left, +z up."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Spot:
    """Which of a scene's worlds, and where in it the vehicle stands."""

    seed: int = 0
    """Added to the world's own seed: another form of a built-in world."""
    place: float | None = None
    """Which of the world's places, as a share in [0, 1) of their list; None is the scene's own."""


@dataclass(frozen=True)
class View:
    """A perspective camera."""

    name: str
    origin: Vector
    """Position in metres."""
    target: Vector
    """A point in the middle of the picture, in metres."""
    up: Vector
    """Any vector that points upwards in the picture."""
    fov: float
    """Horizontal field of view in degrees, in (0, 180)."""
    width: int
    """Pixels per row."""
    height: int
    """Rows."""
    spot: Spot = Spot()
    """Where in the scene's world the vehicle stands; without a world it makes no difference."""


def orbit_view(
    azimuth: float,
    elevation: float,
    distance: float,
    *,
    fov: float,
    width: int,
    height: int,
    target: Vector = (0.0, 0.0, 0.7),
    name: str | None = None,
    spot: Spot | None = None,
) -> View:
    """A camera that circles ``target`` (angles in degrees, lengths in metres).

    Azimuth 0 looks at the vehicle's front, 90 at its left side; elevation is above the horizon.
    """
    a, e = math.radians(azimuth), math.radians(elevation)
    direction = (math.cos(a) * math.cos(e), math.sin(a) * math.cos(e), math.sin(e))
    origin = tuple(t + distance * d for t, d in zip(target, direction, strict=True))
    # Looking straight down, "up" in the picture is the direction in which the vehicle drives.
    up = (0.0, 0.0, 1.0) if abs(elevation) < 89.9 else (1.0, 0.0, 0.0)
    label = name or f"azimuth{azimuth:g}_elevation{elevation:g}_distance{distance:g}"
    spot = spot or Spot()
    return View(label, origin, target, up, fov, width, height, spot)  # type: ignore[arg-type]


def circle(
    frames: int, elevation: float, distance: float, *, start: float = 0.0, **camera: Any
) -> list[View]:
    """So many views, evenly around, from azimuth ``start`` on; ``camera`` as for one of them."""
    azimuths = ((start + 360 * frame / frames) % 360 for frame in range(frames))
    return [orbit_view(azimuth, elevation, distance, **camera) for azimuth in azimuths]


def orbit_of(view: View, target: Vector = (0.0, 0.0, 0.7)) -> tuple[float, float, float]:
    """Azimuth in [0, 360), elevation (degrees) and distance (metres) of the camera from ``target``.

    The inverse of :func:`orbit_view`, and as well defined for cameras that look elsewhere.
    """
    x, y, z = (o - t for o, t in zip(view.origin, target, strict=True))
    distance = math.hypot(x, y, z)
    elevation = math.degrees(math.atan2(z, math.hypot(x, y)))
    return math.degrees(math.atan2(y, x)) % 360, elevation, distance
