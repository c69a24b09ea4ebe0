"""Measured environments: latitude–longitude pictures of the light from all around.

A photographed sun covers a few texels, which rays would seldom meet.  It is found and split off as
a directional sun: what a small disc around the brightest point holds above the sky around it,

    E = ∫ (L − L_around) ω dω,

a vector, so that each surface that sees the whole disc keeps its irradiance exactly (Lambert's
vector irradiance).  What remains is the sky.  Nothing is split off where nothing is a sun: where
the brightest point is broad, one of many, below the horizon, or next to nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float

from cnca.core.errors import SceneError
from cnca.core.images import read_radiance
from cnca.scene.weather import SkyMap

MOST_ROWS = 2048
"""Rows of a map that is kept; finer ones are averaged."""
DISC = 3.0
"""Degrees around the brightest point that count as the sun, its glare and blur included."""
RING = 4.5
"""Degrees up to where the sky around it is measured."""
LEAST_SHARE = 0.05
"""Least part of the light on a surface facing it for which a sun is split off."""
MOST_RIVAL = 0.3
"""Light of the next such source relative to the brightest, from which on it is one lamp of many."""
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Luminance weights of linear Rec. 709 red, green and blue."""


@dataclass(frozen=True, eq=False)
class Environment:
    """A map in our axes, +z up, before it is turned and scaled."""

    radiance: Float[np.ndarray, "rows columns 3"]
    """Linear RGB without the sun; row 0 looks up, column 0 along +x, columns counter-clockwise.

    The middle of the picture looks along +x, its right half to the right.
    """
    sun_direction: Float[np.ndarray, "3"]
    """Unit vector towards the sun; straight up where there is none."""
    sun_irradiance: Float[np.ndarray, "3"]
    """Its irradiance on a surface that faces it; zero where there is none."""
    contrast: float
    """Of the light on level ground: the sky's standard deviation, ray by ray, over the mean of all.

    The sun, which one ray finds for certain, is part of that mean alone.
    """

    @property
    def has_sun(self) -> bool:
        """Whether a sun was split off."""
        return bool(self.sun_irradiance.max() > 0)

    @property
    def sun_altitude(self) -> float:
        """Degrees above the horizon; 0 where there is none."""
        return float(np.degrees(np.arcsin(self.sun_direction[2]))) if self.has_sun else 0.0

    @property
    def sun_azimuth(self) -> float:
        """Degrees counter-clockwise from +x; 0 where there is none."""
        x, y, _ = self.sun_direction
        return float(np.degrees(np.arctan2(y, x)))


def sky_directions(rows: int, columns: int) -> Float[np.ndarray, "rows columns 3"]:
    """Unit vectors at the texel centers of a latitude–longitude map."""
    theta = (np.arange(rows) + 0.5) * np.pi / rows
    phi = (np.arange(columns) + 0.5) * 2 * np.pi / columns
    theta, phi = np.meshgrid(theta, phi, indexing="ij")
    x, y = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi)
    return np.stack([x, y, np.cos(theta)], axis=-1)


def sky_solid_angles(rows: int, columns: int) -> Float[np.ndarray, "rows 1"]:
    """Exact solid angle of one texel of each row, in steradians."""
    edges = np.cos(np.arange(rows + 1) * np.pi / rows)
    return ((edges[:-1] - edges[1:]) * 2 * np.pi / columns)[:, None]


def level_weights(rows: int, columns: int) -> Float[np.ndarray, "rows 1"]:
    """∫ cos θ dω over one texel of each row: what it adds to level ground; 0 below the horizon."""
    edges = np.minimum(np.arange(rows + 1) * np.pi / rows, np.pi / 2)
    return (np.diff(np.sin(edges) ** 2) * np.pi / columns)[:, None]


def read_environment(sky: SkyMap) -> Environment:
    """The map in a file; kept as long as the file stays the same.

    Raises:
        SceneError: there is no such file.
        TextureError: it cannot be read, or holds NaN, infinite or negative values.
    """
    path = Path(sky.file)
    try:
        state = path.stat()
    except OSError:
        hint = sky.missing or "paths start at the scene file's folder"
        raise SceneError(f"sky.map: {path}: no such file; {hint}") from None
    return _read(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=4)
def _read(path: Path, _modified: int, _size: int) -> Environment:
    pixels = read_radiance(path)
    height, width = pixels.shape[:2]
    if width != 2 * height and (height, width) != (1, 1):
        raise SceneError(
            f"sky.map: {path}: is {width} × {height}; a latitude–longitude map is twice as wide as "
            "high, so convert it to one"
        )
    if height > MOST_ROWS:
        area = (2 * MOST_ROWS, MOST_ROWS)
        pixels = cv2.resize(pixels, area, interpolation=cv2.INTER_AREA)
    # Pictures run clockwise, and their middle looks ahead.
    turned = np.roll(pixels[:, ::-1], -(pixels.shape[1] // 2), axis=1)
    return split_sun(turned)


def split_sun(radiance: Float[np.ndarray, "rows columns 3"]) -> Environment:
    """Find the sun of a map in our axes, and take it out."""
    radiance = np.ascontiguousarray(radiance, dtype=np.float32)
    rows, columns = radiance.shape[:2]
    luminance = radiance @ LUMINANCE
    directions = sky_directions(rows, columns)
    solid_angles = sky_solid_angles(rows, columns)
    brightest = np.unravel_index(int(luminance.argmax()), luminance.shape)
    none = Environment(radiance, np.array([0.0, 0.0, 1.0]), np.zeros(3), _contrast(luminance))
    if not luminance[brightest] > 0 or rows < 64:  # a texel would be wider than the disc
        return none
    centre = directions[brightest]
    excess = _excess(radiance, directions, centre)
    vector = np.einsum("rcx,rcy->xy", excess * solid_angles[..., None], directions)
    light = LUMINANCE @ vector
    strength = float(np.linalg.norm(light))
    if strength == 0 or light[2] <= 0:
        return none
    direction = light / strength
    rest = radiance - excess
    facing = (directions @ direction).clip(min=0) * solid_angles
    share = strength / (strength + float(((rest @ LUMINANCE) * facing).sum()))
    if share < LEAST_SHARE or _rival(rest, directions, solid_angles) > MOST_RIVAL * strength:
        return none
    irradiance = np.linalg.norm(vector, axis=1)
    rest = rest.astype(np.float32)
    sun = float(LUMINANCE @ irradiance) * direction[2]
    return Environment(rest, direction, irradiance, _contrast(rest @ LUMINANCE, sun))


def _excess(
    radiance: Float[np.ndarray, "rows columns 3"],
    directions: Float[np.ndarray, "rows columns 3"],
    centre: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "rows columns 3"]:
    """What a disc holds above the median of the ring around it."""
    cosine = directions @ centre
    disc = cosine > np.cos(np.radians(DISC))
    ring = (cosine > np.cos(np.radians(RING))) & ~disc
    around = np.median(radiance[ring], axis=0)
    excess = np.zeros(radiance.shape)
    excess[disc] = (radiance[disc] - around).clip(min=0)
    return excess


def _rival(
    rest: Float[np.ndarray, "rows columns 3"],
    directions: Float[np.ndarray, "rows columns 3"],
    solid_angles: Float[np.ndarray, "rows 1"],
) -> float:
    """Light of the brightest compact source that is left."""
    luminance = rest @ LUMINANCE
    centre = directions[np.unravel_index(int(luminance.argmax()), luminance.shape)]
    excess = _excess(rest, directions, centre) @ LUMINANCE
    return float((excess * solid_angles).sum())


def _contrast(luminance: Float[np.ndarray, "rows columns"], sun: float = 0.0) -> float:
    """Rays leave level ground in proportion to their cosine; ``sun`` is its irradiance there."""
    weights = np.broadcast_to(level_weights(*luminance.shape), luminance.shape)
    mean = float(np.average(luminance, weights=weights))
    square = float(np.average(luminance.astype(np.float64) ** 2, weights=weights))
    deviation, whole = np.sqrt(max(square - mean**2, 0.0)), mean + sun / np.pi
    return float(deviation / whole) if whole > 0 else 0.0
