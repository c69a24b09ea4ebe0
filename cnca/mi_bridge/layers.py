"""What the cameras see first: mask, depth, UV, normal; and the vehicle's bounding box."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float

from cnca.core.errors import SceneError
from cnca.core.types import Boxes
from cnca.mi_bridge.geometry import Geometry
from cnca.mi_bridge.panes import sees_vehicle
from cnca.mi_bridge.rays import Cameras, average_samples
from cnca.mi_bridge.variant import dr, mi
from cnca.scene.cameras import View
from cnca.scene.layers import Layers

MASK_SAMPLES = 8
INSIDE_SHARE = 0.95
"""A camera that sees the vehicle in more than this share of the sky is inside of it."""


def vehicle_mask(
    geometry: Geometry, cameras: Cameras, samples: int = MASK_SAMPLES
) -> Float[np.ndarray, "*film"]:
    """Share of each pixel that the vehicle covers, in [0, 1]."""
    ray, _ = cameras.rays(samples)
    covered = dr.select(sees_vehicle(geometry, ray), mi.Float(1), 0)
    return np.array(average_samples(covered, samples)).reshape(cameras.film_shape)


def first_hits(geometry: Geometry, cameras: Cameras) -> Layers:
    """Trace one ray per pixel, and a few for the mask."""
    with dr.suspend_grad():
        ray, _ = cameras.rays(1)
        si = geometry.scene.ray_intersect(ray)
        on_vehicle, hit = geometry.is_vehicle(si), si.is_valid()
        u = dr.select(on_vehicle, si.uv.x, 0)
        v = dr.select(on_vehicle, 1 - si.uv.y, 0)
        normal = dr.select(hit, mi.Vector3f(si.sh_frame.n), 0)
        albedo = dr.select(hit, si.bsdf().eval_diffuse_reflectance(si, hit), 0)
        depth = dr.select(hit, si.t, dr.inf)
    shape = (cameras.count, cameras.height, cameras.width)
    return Layers(
        mask=vehicle_mask(geometry, cameras),
        depth=_picture(shape, depth)[..., 0],
        uv=_picture(shape, u, v),
        normal=_picture(shape, *normal),
        albedo=_picture(shape, *mi.Color3f(albedo)),
    )


def mask_boxes(mask: Float[np.ndarray, "views height width"], views: Sequence[View]) -> Boxes:
    """Bounding box of the covered pixels of each view; raises SceneError for an empty mask."""
    boxes = []
    for covered, view in zip(mask > 0, views, strict=True):
        rows, columns = np.flatnonzero(covered.any(axis=1)), np.flatnonzero(covered.any(axis=0))
        if not len(rows):
            raise SceneError(f"camera {view.name}: does not see the vehicle; turn it or go nearer")
        boxes.append([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1])
    return torch.tensor(boxes, dtype=torch.float32)


def refuse_inside(geometry: Geometry, view: View, directions: int = 256) -> None:
    """Raise SceneError where the camera is inside the vehicle, which may be open at the bottom."""
    k = np.arange(directions) + 0.5
    cosine, angle = k / directions, k * np.pi * (3 - np.sqrt(5))  # Fibonacci hemisphere
    sine = np.sqrt(1 - cosine**2)
    d = mi.Vector3f(sine * np.cos(angle), sine * np.sin(angle), cosine)
    si = geometry.scene.ray_intersect(mi.Ray3f(mi.Point3f(*view.origin), d))
    share = float(dr.count(geometry.is_vehicle(si))[0]) / directions
    if share > INSIDE_SHARE:
        raise SceneError(f"camera {view.name}: is inside the vehicle; increase its distance")


def _picture(shape: tuple[int, int, int], *channels: mi.Float) -> np.ndarray:
    return np.stack([np.array(channel).reshape(shape) for channel in channels], axis=-1)
