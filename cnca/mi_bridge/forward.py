"""Fog in front of a vehicle: the light that it scatters forwards comes from the vehicle itself.

Away from the vehicle the light in fog is horizontally uniform (:mod:`cnca.mi_bridge.fog`).  On a
ray that ends on the vehicle it is not: droplets scatter forwards, so most of what they send on
towards the camera came from the vehicle, not from the bare ground behind it.  Let f(u) be the share
of scattered light that comes from the vehicle at the distance u in front of its surface, and take
its radiance for that of the ray, L.  The transfer equation with s along the ray then reads

    dL/ds = −σ (1 − ϖ f(u)) L + σ (J − ϖ f(u) I),    u = ℓ − s,

I and J the radiance and the source function of bare ground, and is solved by the same transmittance
as before with the optical depth σ (ℓ − ϖ Φ), Φ(u) = ∫₀ᵘ f.  It is δ-scaling (Joseph, Wiscombe &
Weinman 1976) by as much of the phase function as the vehicle fills at each distance.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cnca.mi_bridge.geometry import Geometry
from cnca.mi_bridge.variant import dr, mi

DISTANCES = 48
MIDDLE = 2.0
"""Metres: half of the table's entries lie nearer to the surface."""
NEAREST = 1e-3
"""Metres: off the surface, which a ray from it would meet again."""
RAYS = 8192
"""Rays towards the vehicle for each distance; about a third of them meet it."""
ELEVATIONS = (0.0, 30.0)
"""Degrees above the horizon from which cameras look."""


class ForwardShare:
    """f and Φ of one vehicle and one phase function, as tables that kernels read."""

    def __init__(self, geometry: Geometry, asymmetry: float) -> None:
        self.geometry = geometry
        self.top = float(geometry.vehicle_bounds[1][2])  # of the vehicle, in metres
        share = measure_share(geometry, asymmetry)
        table = np.stack([share, integrated(share)], axis=-1)
        self._table = mi.Texture1f(mi.TensorXf(np.float32(table)), wrap_mode=dr.WrapMode.Clamp)

    def __call__(self, u: mi.Float, active: mi.Bool) -> tuple[mi.Float, mi.Float]:
        """f and Φ (metres) at distance ``u`` ≥ 0 in front of the surface."""
        w = (u / (u + MIDDLE) * (DISTANCES - 1) + 0.5) / DISTANCES
        share, integral = self._table.eval(mi.Point1f(w), active)
        return share, integral


def table_distances() -> Float[np.ndarray, " distances"]:
    """Distances in metres of the table's entries, from 0 to ∞."""
    w = np.arange(DISTANCES) / (DISTANCES - 1)
    return MIDDLE * w / np.maximum(1 - w, 1e-12)


def measure_share(
    geometry: Geometry, asymmetry: float, *, seed: int = 0
) -> Float[np.ndarray, " distances"]:
    """f(u): how often light that reaches the camera's ray by one scattering left the vehicle.

    Averaged over the vehicle's visible points, as pixels see them, and over cameras all around.
    """
    rng = np.random.default_rng(seed)
    u = table_distances()[:-1]
    low, high = geometry.vehicle_bounds
    centre, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    origin, to_camera = _camera_rays(rng, centre, radius, len(u) * RAYS)
    scattered = henyey_greenstein_directions(rng, asymmetry, len(u) * RAYS)
    away = -_vectors(to_camera)
    si = geometry.scene.ray_intersect(mi.Ray3f(mi.Point3f(_vectors(origin)), away))
    seen = geometry.is_vehicle(si)
    in_front = mi.Float(np.float32(np.maximum(u, NEAREST)).repeat(RAYS))
    ray = mi.Ray3f(si.p - in_front * away, mi.Frame3f(away).to_world(_vectors(scattered)))
    returned = seen & geometry.is_vehicle(geometry.scene.ray_intersect(ray, seen))
    dr.eval(seen, returned)
    counts = [np.array(lanes).reshape(len(u), RAYS).sum(axis=1) for lanes in (returned, seen)]
    return np.append(counts[0] / counts[1], 0.0)


def _vectors(rows: Float[np.ndarray, "rays 3"]) -> mi.Vector3f:
    return mi.Vector3f(*(mi.Float(np.ascontiguousarray(axis, np.float32)) for axis in rows.T))


def integrated(share: Float[np.ndarray, " distances"]) -> Float[np.ndarray, " distances"]:
    """Φ(u) in metres; beyond the last finite distance f falls with its square."""
    u = table_distances()[:-1]
    steps = np.diff(u) * (share[1:-1] + share[:-2]) / 2
    inner = np.concatenate([[0.0], np.cumsum(steps)])
    return np.append(inner, inner[-1] + share[-2] * u[-1])


def henyey_greenstein_directions(
    rng: np.random.Generator, asymmetry: float, count: int
) -> Float[np.ndarray, "count 3"]:
    """Unit vectors around +z, drawn from the phase function (Witt 1977)."""
    ξ, φ, g = rng.random(count), 2 * np.pi * rng.random(count), asymmetry
    if abs(g) < 1e-3:
        cosine = 2 * ξ - 1
    else:
        cosine = (1 + g * g - ((1 - g * g) / (1 - g + 2 * g * ξ)) ** 2) / (2 * g)
    sine = np.sqrt(np.maximum(1 - cosine**2, 0.0))
    return np.stack([sine * np.cos(φ), sine * np.sin(φ), cosine], axis=-1)


def _camera_rays(
    rng: np.random.Generator, centre: Float[np.ndarray, "3"], radius: float, count: int
) -> tuple[Float[np.ndarray, "rays 3"], Float[np.ndarray, "rays 3"]]:
    """Origins on discs that cover the vehicle, and unit vectors from there to far cameras."""
    azimuth = 2 * np.pi * rng.random(count)
    elevation = np.radians(rng.uniform(*ELEVATIONS, count))
    d = np.stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ],
        axis=-1,
    )
    right = np.stack([-np.sin(azimuth), np.cos(azimuth), np.zeros(count)], axis=-1)
    up = np.cross(d, right)
    r, φ = radius * np.sqrt(rng.random(count)), 2 * np.pi * rng.random(count)
    offset = (r * np.cos(φ))[:, None] * right + (r * np.sin(φ))[:, None] * up
    return centre + 2 * radius * d + offset, d
