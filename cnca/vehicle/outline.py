"""How well a vehicle's outline meets a photograph, and the lift that makes it meet best.

GrabCut (Rother, Kolmogorov and Blake, 2004) parts the photograph into vehicle and surroundings: the
projected mesh says roughly where the vehicle is, and within 15 pixels of its outline the colors
and edges of the photograph decide.  Edges alone would not do: a lane marking or a kerb that runs
along the roof is a stronger edge than the roof's own.  The error is the distance in pixels from the
points of either outline to the other one.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from cnca.core.errors import SceneError
from cnca.core.images import SrgbArray
from cnca.scene.cameras import View
from cnca.vehicle.model import Vehicle

REACH = 15
"""Pixels to either side of the projected outline in which the photograph decides."""
_SURROUNDINGS = 4 * REACH
"""Pixels around the vehicle whose colors stand for the surroundings'."""
_SUBPIXEL_BITS = 4


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
        # A pixel's centre has integer coordinates in OpenCV, half-integer ones here.
        fixed = np.rint((pixels - 0.5) * 2**_SUBPIXEL_BITS).astype(np.int32)
        for triangle in fixed[part.faces]:
            cv2.fillConvexPoly(mask, triangle, 1, shift=_SUBPIXEL_BITS)
    return mask.astype(bool)


def photographed_silhouette(
    mask: Bool[np.ndarray, "height width"], photograph: SrgbArray
) -> Bool[np.ndarray, "height width"]:
    """Return the pixels of the photographed vehicle, which ``mask`` covers to within :data:`REACH`.

    Raises SceneError if no outline of a vehicle wider than twice that lies in the picture.
    """
    covered = mask.astype(np.uint8)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * REACH + 1, 2 * REACH + 1))
    core = cv2.erode(covered, disc) > 0
    if not core.any() or mask.all():
        raise SceneError(
            f"no outline of a vehicle wider than {2 * REACH} pixels lies in the picture; "
            "check the camera's pose and lift"
        )
    labels = np.where(mask, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    labels[cv2.dilate(covered, disc) == 0] = cv2.GC_BGD
    labels[core] = cv2.GC_FGD
    x, y, width, height = cv2.boundingRect(covered)
    rows = slice(max(y - _SURROUNDINGS, 0), y + height + _SURROUNDINGS)
    columns = slice(max(x - _SURROUNDINGS, 0), x + width + _SURROUNDINGS)
    near = np.ascontiguousarray(labels[rows, columns])
    picture = np.rint(photograph[rows, columns] * 255).astype(np.uint8)
    cv2.setRNGSeed(0)  # the first clusters of colors are drawn at random
    cv2.grabCut(picture, near, None, None, None, 5, cv2.GC_INIT_WITH_MASK)
    cut = np.zeros_like(covered)
    cut[rows, columns] = np.isin(near, (cv2.GC_FGD, cv2.GC_PR_FGD))
    whole = cv2.drawContours(np.zeros_like(cut), [_outline(cut > 0)], -1, 1, cv2.FILLED)
    return whole.astype(bool)


def outline_distances(
    drawn: Bool[np.ndarray, "height width"], photographed: Bool[np.ndarray, "height width"]
) -> Float[np.ndarray, " points"]:
    """Return how many pixels the points of either outline lie from the other outline.

    Points on the border of the picture are left out: it cuts off both.
    """
    return np.concatenate(
        [np.abs(_offsets(drawn, photographed)[1]), np.abs(_offsets(photographed, drawn)[1])]
    )


def fit_lift(vehicle: Vehicle, view: View, photograph: SrgbArray) -> float:
    """Return the metres by which the vehicle must be lifted to meet the photograph best.

    They add to the ``lift`` that :func:`cnca.scene.carla.carla_view` was given.
    A Gauss–Newton iteration in one unknown: raising the vehicle by ``d`` moves an outline point
    along its normal ``n`` by ``d · n·∂p/∂z``; the distance to the photograph's outline is thus one
    estimate of ``d`` for each point, and their median, weighted by ``|n·∂p/∂z|``, is the least
    absolute deviation solution.  The view's own lift must be right to within about
    :data:`REACH` pixels.  Raises SceneError as :func:`silhouette` and
    :func:`photographed_silhouette` do.
    """
    photographed = photographed_silhouette(silhouette(vehicle, view), photograph)
    lift = 0.0
    for _ in range(5):
        raised = _raised(view, lift)
        normals, offsets = _offsets(silhouette(vehicle, raised), photographed)
        motion = normals @ _pixels_per_metre(raised)
        useful = np.abs(motion) > 0.3 * np.abs(motion).max()
        lift += _weighted_median(offsets[useful] / motion[useful], np.abs(motion[useful]))
    return lift


def _outline(mask: Bool[np.ndarray, "height width"]) -> Int[np.ndarray, "points 2"]:
    """The last pixels (x, y) inside the mask's piece with the longest outline, in order."""
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return max(contours, key=len)[:, 0]


def _offsets(
    mask: Bool[np.ndarray, "height width"], other: Bool[np.ndarray, "height width"]
) -> tuple[Float[np.ndarray, "points 2"], Float[np.ndarray, " points"]]:
    """Outward unit normals of the mask's outline, and how far it must move to meet the other's."""
    points = _outline(mask)
    inside = ((points > 0) & (points < np.array(mask.shape[::-1]) - 1)).all(axis=1)
    x, y = points[inside].T
    # The blurred mask falls from 1 inside to 0 outside, so that its gradient points inwards.
    field = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), 2.0)
    slopes = np.stack([cv2.Sobel(field, cv2.CV_32F, 1, 0), cv2.Sobel(field, cv2.CV_32F, 0, 1)], -1)
    inward = slopes[y, x]
    normals = -inward / np.maximum(np.linalg.norm(inward, axis=1, keepdims=True), 1e-6)
    # An outline's pixels are the last ones inside, at a distance of 1 from the nearest outside.
    depth = cv2.distanceTransform(other.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) - 1
    height = cv2.distanceTransform(1 - other.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return normals, np.where(other, depth, -height)[y, x]


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
