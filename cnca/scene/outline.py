"""How well a vehicle's outline meets a photograph, and the lift that makes it meet best.

The measure needs no segmentation: from points on the outline of the projected mesh it looks along
the outline's normal, up to 15 pixels to either side, for the outermost prominent edge of the
photograph.  Outermost, because a vehicle is full of edges of its own (windows, wheels); prominent,
because the ground has faint ones.  The signed distances in pixels are the error.  Their median
shrugs off points where a lane marking lies beside the vehicle; edges at random would give 7 px.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float

from cnca.errors import SceneError
from cnca.scene.cameras import View
from cnca.scene.images import SrgbArray
from cnca.scene.mesh import Vehicle

REACH = 15.0
"""Pixels to either side of the outline in which edges are looked for."""
PROMINENT = 0.5
"""An edge counts from this fraction of the strongest one within reach."""
_SUBPIXEL_BITS = 4


@dataclass(frozen=True)
class OutlineFit:
    """A fitted lift and how well the outlines then meet."""

    lift: float
    """Metres to pass to :func:`cnca.scene.carla.carla_view` in addition to the views' own."""
    errors: tuple[float, ...]
    """Median distance from outline to edge in pixels, one for each photograph."""


def project(
    points: Float[np.ndarray, "points 3"], view: View
) -> tuple[Float[np.ndarray, "points 2"], Float[np.ndarray, " points"]]:
    """Return pixels (x right, y down, origin at the top left corner) and depth in metres.

    Points at or behind the camera have depth ≤ 0 and meaningless pixel coordinates.
    """
    origin = np.array(view.origin)
    forward = np.array(view.target) - origin
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, view.up)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(forward, right), forward])
    x, y, depth = axes @ (points - origin).T
    focal = view.width / (2 * np.tan(np.radians(view.fov) / 2))
    safe = np.where(depth > 0, depth, np.inf)
    centre = np.array([view.width, view.height]) / 2
    return np.stack([x, y], axis=1) * (focal / safe)[:, None] + centre, depth


def silhouette(vehicle: Vehicle, view: View) -> Bool[np.ndarray, "height width"]:
    """Return the pixels that the vehicle covers.

    Raises SceneError if a part of the vehicle is at or behind the camera.
    """
    mask = np.zeros((view.height, view.width), np.uint8)
    for part in vehicle.parts:
        pixels, depth = project(part.vertices, view)
        if depth.min() <= 0:
            raise SceneError(
                f"view '{view.name}': part of the vehicle is behind the camera; move it away"
            )
        # A pixel's centre has whole-numbered coordinates for OpenCV, half-numbered ones for us.
        fixed = np.rint((pixels - 0.5) * 2**_SUBPIXEL_BITS).astype(np.int32)
        for triangle in fixed[part.faces]:
            cv2.fillConvexPoly(mask, triangle, 1, shift=_SUBPIXEL_BITS)
    return mask.astype(bool)


def edge_offsets(
    mask: Bool[np.ndarray, "height width"], photograph: SrgbArray, *, reach: float = REACH
) -> tuple[Float[np.ndarray, "points 2"], Float[np.ndarray, " points"]]:
    """Look for the photograph's edge near every third point of the mask's outline.

    Returns the outline's outward unit normals (x right, y down) and the signed distance in pixels,
    positive outwards, to the outermost edge within ``reach`` that is :data:`PROMINENT`.  Points
    whose search would leave the picture are left out.
    """
    points, normals = _outline(mask)
    distances = np.arange(-reach, reach + 0.25, 0.5)
    samples = (points[:, None] + distances[:, None] * normals[:, None]).astype(np.float32)
    height, width = mask.shape
    inside = ((samples >= 1) & (samples <= (width - 2, height - 2))).all(axis=(1, 2))
    samples, normals = samples[inside], normals[inside]
    smooth = cv2.GaussianBlur(photograph, (0, 0), 1.0)
    profile = cv2.remap(smooth, samples[..., 0], samples[..., 1], cv2.INTER_LINEAR)
    strength = np.linalg.norm(np.gradient(profile, axis=1), axis=2)
    padded = np.pad(strength, ((0, 0), (1, 1)))
    peak = (strength >= padded[:, :-2]) & (strength >= padded[:, 2:])
    peak &= strength >= PROMINENT * strength.max(axis=1, keepdims=True)
    outermost = len(distances) - 1 - peak[:, ::-1].argmax(axis=1)
    return normals, distances[outermost]


def fit_lift(
    vehicle: Vehicle, views: Sequence[View], photographs: Sequence[SrgbArray]
) -> OutlineFit:
    """Return by how much the vehicle must be lifted for its outline to meet the photographs.

    A Gauss–Newton iteration in one unknown: raising the vehicle by ``d`` moves an outline point
    along its normal ``n`` by ``d · n·∂p/∂z``; each edge offset is thus one estimate of ``d``, and
    their median, weighted by ``|n·∂p/∂z|``, is the least absolute deviation solution.
    The views' own lift must be right to within about 15 pixels; later rounds look less far, so that
    lane markings count for less.  Raises SceneError if a view has the vehicle behind the camera.
    """
    lift = 0.0
    for reach in (REACH, REACH, REACH / 2, REACH / 2, REACH / 3, REACH / 3):
        estimates, weights = [], []
        for view, photograph in zip(views, photographs, strict=True):
            raised = _raised(view, lift)
            normals, offsets = edge_offsets(silhouette(vehicle, raised), photograph, reach=reach)
            motion = normals @ _pixels_per_metre(raised)
            useful = np.abs(motion) > 0.3 * np.abs(motion).max()
            estimates.append(offsets[useful] / motion[useful])
            weights.append(np.abs(motion[useful]))
        lift += _weighted_median(np.concatenate(estimates), np.concatenate(weights))
    pairs = zip(views, photographs, strict=True)
    return OutlineFit(lift, tuple(outline_error(vehicle, _raised(v, lift), p) for v, p in pairs))


def outline_error(vehicle: Vehicle, view: View, photograph: SrgbArray) -> float:
    """Return the median distance in pixels between the vehicle's outline and the nearby edges."""
    return float(np.median(np.abs(edge_offsets(silhouette(vehicle, view), photograph)[1])))


def _outline(
    mask: Bool[np.ndarray, "height width"],
) -> tuple[Float[np.ndarray, "points 2"], Float[np.ndarray, "points 2"]]:
    """Every third point of the outer contour and its outward normal, in OpenCV's coordinates."""
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    points = max(contours, key=len)[::3, 0]
    # The blurred mask falls from 1 inside to 0 outside, so that its gradient points inwards.
    field = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), 2.0)
    slopes = np.stack([cv2.Sobel(field, cv2.CV_32F, 1, 0), cv2.Sobel(field, cv2.CV_32F, 0, 1)], -1)
    inward = slopes[points[:, 1], points[:, 0]]
    normals = -inward / np.maximum(np.linalg.norm(inward, axis=1, keepdims=True), 1e-6)
    # The points are the centres of the last pixels inside; the outline runs half a pixel further.
    return points + 0.5 * normals, normals


def _raised(view: View, lift: float) -> View:
    """The view of a vehicle that stands ``lift`` metres higher: the camera moves down instead."""
    (x, y, z), (tx, ty, tz) = view.origin, view.target
    return replace(view, origin=(x, y, z - lift), target=(tx, ty, tz - lift))


def _pixels_per_metre(view: View) -> Float[np.ndarray, "2"]:
    """How far the middle of the vehicle moves in the picture when it is raised by a metre."""
    middle = np.array([[0, 0, 0.7], [0, 0, 0.71]])
    pixels, _ = project(middle, view)
    return (pixels[1] - pixels[0]) / 0.01


def _weighted_median(
    values: Float[np.ndarray, " values"], weights: Float[np.ndarray, " values"]
) -> float:
    order = np.argsort(values)
    passed = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(passed, passed[-1] / 2)])
