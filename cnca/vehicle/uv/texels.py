"""What lies where on the vehicle's texture, and textures of other kinds drawn onto it.

A pattern that repeats is projected as DTA and ACTIVE do it (the world-aligned texture of the Unreal
Engine, triplanar mapping): each point of the paint takes the pattern from the one of the three
planes of the vehicle's axes that its normal faces most.  Unreal blends the planes near 45°; here
the borders are sharp.  Colors for each face are those of FCA, drawn by Kato's neural renderer.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import distance_transform_edt

from cnca.core.errors import TextureError
from cnca.core.images import SrgbArray
from cnca.vehicle.model import Part, Vehicle
from cnca.vehicle.uv.rebake import face_of_texels

PLANES = ((1, 2), (0, 2), (0, 1))
"""Axes that run right and up in the pattern, where the normal faces x, y or z."""


@dataclass(frozen=True)
class Texels:
    """The point of the vehicle that each texel shows; off charts, that of the nearest on one."""

    face: Int[np.ndarray, "size size"]
    """Number of the triangle among those of all painted parts, in the mesh file's order."""
    weights: Float[np.ndarray, "size size 3"]
    """Barycentric coordinates in that triangle."""
    position: Float[np.ndarray, "size size 3"]
    """Metres, +x front, +y left, +z up."""
    normal: Float[np.ndarray, "size size 3"]
    """Unit shading normal."""
    faces: int
    """How many triangles there are."""
    texel_length: float
    """Metres across the typical (median) texel."""


def map_texels(vehicle: Vehicle, size: int) -> Texels:
    """Find out what each texel of a ``size``² texture shows; row 0 is v = 1."""
    parts = [part for part in vehicle.parts if part.material == "paint"]
    corners = np.concatenate([_texture_corners(part) for part in parts])
    points = np.concatenate([part.vertices[part.faces] for part in parts])
    normals = np.concatenate([part.normals[part.faces] for part in parts])
    owner = face_of_texels(corners, size)
    rows, columns = distance_transform_edt(owner < 0, return_distances=False, return_indices=True)
    face = owner[rows, columns]
    centre = np.stack([(columns + 0.5) / size, 1 - (rows + 0.5) / size], axis=-1)
    weights = _barycentric(corners[face], centre)
    normal = np.einsum("ijk,ijkc->ijc", weights, normals[face])
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    # Opposite normals at a triangle's corners may cancel out: any of them will do then.
    normal = np.where(length > 1e-6, normal / np.maximum(length, 1e-6), normals[face][..., 0, :])
    drawn = face[owner >= 0]
    texel_areas = _area(points)[drawn] / (np.abs(_doubled_area(corners))[drawn] / 2 * size**2)
    return Texels(
        face=face,
        weights=weights,
        position=np.einsum("ijk,ijkc->ijc", weights, points[face]),
        normal=normal,
        faces=len(corners),
        texel_length=float(np.sqrt(np.median(texel_areas))),
    )


def project_pattern(texels: Texels, pattern: SrgbArray, side: float) -> SrgbArray:
    """A square pattern that repeats every ``side`` metres, as a UV texture.

    Its columns run along +y where the paint faces forwards or backwards, else along +x; its rows
    run down along z, on the roof and the floor along y.  One corner is at the vehicle's origin, on
    the ground below its middle.  It is drawn the same on both sides, so that writing reads right
    on one of them.  Raises TextureError for a pattern that is not square or a side not above 0.
    """
    height, width = pattern.shape[:2]
    if height != width:
        raise TextureError(f"a pattern of {width}×{height} pixels: cut it to a square")
    if not 0 < side < np.inf:
        raise TextureError(f"a pattern every {side:g} m: give a length above 0")
    # Finer than a texel, it would alias.
    pixels = int(np.clip(round(side / texels.texel_length), 1, width))
    shrunk = cv2.resize(pattern, (pixels, pixels), interpolation=cv2.INTER_AREA)
    facing = np.abs(texels.normal).argmax(axis=-1)
    along = np.take_along_axis(texels.position, np.array(PLANES)[facing], axis=-1) / side
    column, row = along[..., 0] % 1 * pixels - 0.5, -along[..., 1] % 1 * pixels - 0.5
    drawn = cv2.remap(
        shrunk,
        column.astype(np.float32),
        row.astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_WRAP,
    )
    return np.clip(drawn.reshape(*facing.shape, 3), 0, 1)


def draw_faces(texels: Texels, colors: Float[np.ndarray, "*shape"]) -> SrgbArray:
    """Colors for each face as a UV texture.

    ``colors`` are sRGB in [0, 1], (faces, 3), or cubes (faces, t, t, t, 3) as in the neural
    renderer, whose axes are the barycentric coordinates times t − 1 (read at the nearest entry);
    a leading axis of 1 is ignored.  Raises TextureError for another shape or value.
    """
    if colors.ndim in (3, 6) and len(colors) == 1:
        colors = colors[0]
    cubes = colors[:, None, None, None] if colors.ndim == 2 else colors
    fits = cubes.ndim == 5 and len(set(cubes.shape[1:4])) == 1 and cubes.shape[4] == 3
    if not fits or len(cubes) != texels.faces:
        raise TextureError(
            f"colors of shape {colors.shape}: the vehicle's paint has {texels.faces} faces; "
            "give (faces, 3) or (faces, t, t, t, 3)"
        )
    if not np.isfinite(cubes).all() or cubes.min() < 0 or cubes.max() > 1:
        span = f"[{cubes.min():.3g}, {cubes.max():.3g}]"
        raise TextureError(f"colors span {span}: scale them into [0, 1], FCA's by (tanh + 1) / 2")
    index = np.rint(texels.weights * (cubes.shape[1] - 1)).astype(int)
    first, second, third = np.moveaxis(index, -1, 0)
    return np.ascontiguousarray(cubes[texels.face, first, second, third], np.float32)


def _texture_corners(part: Part) -> Float[np.ndarray, "faces 3 2"]:
    assert part.uvs is not None  # the paint mask has refused paint without
    return part.uvs[part.faces]


def _barycentric(
    corners: Float[np.ndarray, "*texels 3 2"], points: Float[np.ndarray, "*texels 2"]
) -> Float[np.ndarray, "*texels 3"]:
    """Barycentric coordinates of points; those just outside are moved onto the border."""
    parts = []
    for k in range(3):
        triangle = corners.copy()
        triangle[..., k, :] = points
        parts.append(_doubled_area(triangle))
    shares = np.clip(np.stack(parts, axis=-1) / _doubled_area(corners)[..., None], 0, None)
    return shares / shares.sum(axis=-1, keepdims=True)


def _doubled_area(triangles: Float[np.ndarray, "*n 3 2"]) -> Float[np.ndarray, "*n"]:
    """Twice the area, with a sign that tells the sense of rotation."""
    first, second = (triangles[..., k, :] - triangles[..., 0, :] for k in (1, 2))
    return first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]


def _area(triangles: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, " n"]:
    first, second = (triangles[:, k] - triangles[:, 0] for k in (1, 2))
    return np.linalg.norm(np.cross(first, second), axis=-1) / 2
