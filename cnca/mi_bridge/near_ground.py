"""The ground around the vehicle as one small mesh, where the rest of a world is a panorama.

The vehicle's shadow falls on it, and a texture's lower half gets its light from it.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from cnca.mi_bridge.geometry import Geometry
from cnca.mi_bridge.rays import average_samples
from cnca.mi_bridge.variant import dr, mi
from cnca.mi_bridge.wet import wet_principled
from cnca.mi_bridge.world_shapes import linear_bitmap, make_mesh

HALF = 9.6
"""Metres from the vehicle's middle to the mesh's sides."""
CELLS = 96
"""Squares per side, 20 cm wide."""
TEXELS, SAMPLES = 512, 4
"""Texels per side of its picture, and rays to each."""
TOP = 0.35
"""Metres: what is higher or deeper is not the ground that the vehicle stands on."""
STEP = 0.25
"""Metres: the highest kerb; what is steeper is left to the panorama."""
EYE = 1.0
"""Metres above the ground: what cannot be seen from there is left to the panorama too."""
ROUGHNESS = 0.9


def near_ground(bare: Geometry) -> mi.Mesh | None:
    """The ground of a world around its origin; None where there is none."""
    x, y = _grid(CELLS + 1)
    heights = _heights(bare.scene, x, y)
    known = np.isfinite(heights)
    level = np.where(known, heights, 0.0)
    seen = known & _sees(bare.scene, x, y, level + 0.05)
    corners = [np.s_[:-1, :-1], np.s_[:-1, 1:], np.s_[1:, 1:], np.s_[1:, :-1]]
    at = np.stack([level[corner] for corner in corners])
    free = np.stack([seen[corner] for corner in corners]).all(axis=0)
    free &= at.max(axis=0) - at.min(axis=0) < STEP
    if not free.any():
        return None
    numbers = np.arange(x.size).reshape(x.shape)
    a, b, c, d = (numbers[corner][free] for corner in corners)
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    slopes = np.gradient(level, 2 * HALF / CELLS)
    normals = np.stack([-slopes[1], -slopes[0], np.ones_like(level)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    vertices = np.stack([x, y, level], axis=-1).reshape(-1, 3)
    uvs = (vertices[:, :2] + HALF) / (2 * HALF)
    principled: dict[str, object] = {
        "type": "principled",
        "base_color": linear_bitmap(_albedo(bare.scene)[::-1]),
        "roughness": ROUGHNESS,
        "specular": 0.3,
    }
    if bare.wetness > 0:  # the picture is that of wet ground already
        film = wet_principled(principled, bare.wetness)
        principled = film | {"base_color": principled["base_color"]}
    bsdf = mi.load_dict(
        {
            "type": "twosided",
            "bsdf": principled,
        }
    )
    return make_mesh("near_ground", bsdf, vertices, faces, normals.reshape(-1, 3), uvs)


def _grid(
    count: int,
) -> tuple[Float[np.ndarray, "count count"], Float[np.ndarray, "count count"]]:
    """x and y; rows run along +y."""
    line = np.linspace(-HALF, HALF, count)
    x, y = np.meshgrid(line, line)
    return x, y


def _heights(
    scene: mi.Scene, x: Float[np.ndarray, "rows columns"], y: Float[np.ndarray, "rows columns"]
) -> Float[np.ndarray, "rows columns"]:
    """Heights of the ground, NaN where there is none."""
    si = scene.ray_intersect(
        _down(mi.Float(np.float32(x.ravel())), mi.Float(np.float32(y.ravel())))
    )
    height = dr.select(si.is_valid() & (si.t < 2 * TOP), TOP - si.t, dr.nan)
    return np.array(height, float).reshape(x.shape)


def _down(x: mi.Float, y: mi.Float) -> mi.Ray3f:
    return mi.Ray3f(mi.Point3f(x, y, TOP), mi.Vector3f(0, 0, -1))


def _sees(
    scene: mi.Scene,
    x: Float[np.ndarray, "rows columns"],
    y: Float[np.ndarray, "rows columns"],
    z: Float[np.ndarray, "rows columns"],
) -> Bool[np.ndarray, "rows columns"]:
    """Whether nothing stands between these points and the middle."""
    start = mi.Point3f(*(mi.Float(np.float32(axis.ravel())) for axis in (x, y, z)))
    to_eye = mi.Point3f(0, 0, EYE) - start
    distance = dr.norm(to_eye)
    ray = mi.Ray3f(start, to_eye / distance, distance, 0.0, [])
    return ~np.array(scene.ray_test(ray)).reshape(x.shape)


def _albedo(scene: mi.Scene) -> Float[np.ndarray, "texels texels 3"]:
    """Linear diffuse reflectance seen from above, row 0 at the smallest y."""
    lanes = TEXELS**2 * SAMPLES
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(mi.UInt32(1), lanes)
    texel, jitter = dr.arange(mi.UInt32, lanes) // SAMPLES, sampler.next_2d()
    scale = 2 * HALF / TEXELS
    x = (mi.Float(texel % TEXELS) + jitter.x) * scale - HALF
    y = (mi.Float(texel // TEXELS) + jitter.y) * scale - HALF
    si = scene.ray_intersect(_down(x, y))
    hit = si.is_valid() & (si.t < 2 * TOP)
    color = mi.Color3f(si.bsdf().eval_diffuse_reflectance(si, hit))
    color = dr.select(hit, color, 0)
    share = dr.select(hit, mi.Float(1), 0)
    dr.eval(color, share)
    means = [np.array(average_samples(channel, SAMPLES)) for channel in (*color, share)]
    red, green, blue, known = (mean.reshape(TEXELS, TEXELS) for mean in means)
    albedo = np.stack([red, green, blue], axis=-1)
    usual = albedo.sum(axis=(0, 1)) / max(known.sum(), 1e-9)
    return np.where(known[..., None] > 0, albedo / np.maximum(known, 1e-9)[..., None], usual)
