"""Meshes with texture coordinates in metres, from which the built-in worlds are put together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

Points = Float[np.ndarray, "points 3"]


@dataclass(frozen=True)
class Mesh:
    """Triangles, counter-clockwise seen from outside; lengths and texture coordinates in metres."""

    vertices: Points
    faces: Int[np.ndarray, "faces 3"]
    normals: Points
    uvs: Float[np.ndarray, "points 2"]

    def placed(self, x: float, y: float, z: float = 0.0, heading: float = 0.0) -> Mesh:
        """The mesh turned by ``heading`` (degrees counter-clockwise from above), then moved."""
        angle = math.radians(heading)
        c, s = math.cos(angle), math.sin(angle)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return Mesh(self.vertices @ turn.T + [x, y, z], self.faces, self.normals @ turn.T, self.uvs)


def merge(meshes: Sequence[Mesh]) -> Mesh:
    """All the meshes as one; nothing is welded."""
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([m.faces + start for m, start in zip(meshes, starts, strict=True)]),
        np.concatenate([mesh.normals for mesh in meshes]),
        np.concatenate([mesh.uvs for mesh in meshes]),
    )


def quads(
    corners: Float[np.ndarray, "quads 4 3"],
    uvs: Float[np.ndarray, "quads 4 2"] | None = None,
    offset: tuple[float, float] = (0.0, 0.0),
) -> Mesh:
    """Flat quadrilaterals, each counter-clockwise from its lower left corner.

    Without ``uvs`` the picture lies in the plane in metres from the world's origin (moved by
    ``offset``), its u along the lower edge: what lies in one plane is covered without a seam.
    Those without an area are left out.
    """
    corners = np.asarray(corners, dtype=float)
    across = _cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    whole = np.linalg.norm(across, axis=1) > 1e-9
    corners, uvs = corners[whole], None if uvs is None else np.asarray(uvs)[whole]
    along = _unit(corners[:, 1] - corners[:, 0])
    # The longer diagonal product is right for triangles too, which repeat a corner.
    normal = _unit(across[whole])
    if uvs is None:
        across = _cross(normal, along)
        uvs = np.stack(
            [
                np.einsum("qcx,qx->qc", corners, along),
                np.einsum("qcx,qx->qc", corners, across),
            ],
            axis=-1,
        ) + np.asarray(offset)
    first = 4 * np.arange(len(corners))[:, None]
    faces = np.concatenate([first + [0, 1, 2], first + [0, 2, 3]])
    return Mesh(
        corners.reshape(-1, 3),
        faces,
        np.repeat(normal, 4, axis=0),
        np.asarray(uvs, dtype=float).reshape(-1, 2),
    )


def repeat(mesh: Mesh, offsets: Float[np.ndarray, "copies 3"]) -> Mesh:
    """Copies of a mesh, each moved by its offset; their pictures do not move along."""
    count, size = len(offsets), len(mesh.vertices)
    vertices = mesh.vertices[None] + np.asarray(offsets)[:, None]
    faces = mesh.faces[None] + size * np.arange(count)[:, None, None]
    return Mesh(
        vertices.reshape(-1, 3),
        faces.reshape(-1, 3),
        np.tile(mesh.normals, (count, 1)),
        np.tile(mesh.uvs, (count, 1)),
    )


def rectangle(
    x: tuple[float, float],
    y: tuple[float, float],
    z: float = 0.0,
    offset: tuple[float, float] = (0.0, 0.0),
) -> Mesh:
    """A level rectangle that is seen from above."""
    (a, b), (c, d) = x, y
    return quads(np.array([[[a, c, z], [b, c, z], [b, d, z], [a, d, z]]]), offset=offset)


def box(
    low: Sequence[float],
    high: Sequence[float],
    offset: tuple[float, float] = (0.0, 0.0),
    sides: str = "-x+x-y+y+z",
) -> Mesh:
    """A box between two corners; ``sides`` names those that have faces."""
    (a, c, e), (b, d, f) = low, high
    corners = {
        "-y": [[a, c, e], [b, c, e], [b, c, f], [a, c, f]],
        "+y": [[b, d, e], [a, d, e], [a, d, f], [b, d, f]],
        "-x": [[a, d, e], [a, c, e], [a, c, f], [a, d, f]],
        "+x": [[b, c, e], [b, d, e], [b, d, f], [b, c, f]],
        "+z": [[a, c, f], [b, c, f], [b, d, f], [a, d, f]],
        "-z": [[a, d, e], [b, d, e], [b, c, e], [a, c, e]],
    }
    names = [sides[i : i + 2] for i in range(0, len(sides), 2)]
    return quads(np.array([corners[name] for name in names], dtype=float), offset=offset)


def tube(
    path: Float[np.ndarray, "rings 3"], radii: Float[np.ndarray, " rings"], segments: int = 8
) -> Mesh:
    """A round bar along a path, open at both ends; u runs around it, v along it."""
    path, radii = np.asarray(path, dtype=float), np.asarray(radii, dtype=float)
    along = _unit(np.gradient(path, axis=0))
    # A helper that no ring of a post or an arm is parallel to for long.
    helper = np.where(np.abs(along[:, 2:]) > 0.9, [[1.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]])
    helper = helper[[len(helper) // 2]]
    side = _unit(np.cross(helper, along))
    up = np.cross(along, side)
    angle = np.linspace(0.0, 2 * np.pi, segments + 1)
    normals = (
        side[:, None] * np.cos(angle)[None, :, None] + up[:, None] * np.sin(angle)[None, :, None]
    )
    vertices = path[:, None] + radii[:, None, None] * normals
    run = np.append(0.0, np.linalg.norm(np.diff(path, axis=0), axis=1).cumsum())
    uvs = np.stack(np.broadcast_arrays(angle[None] * radii.max(), run[:, None]), axis=-1)
    return Mesh(
        vertices.reshape(-1, 3),
        _grid(len(path), segments + 1),
        normals.reshape(-1, 3),
        uvs.reshape(-1, 2),
    )


def disc(centre: Sequence[float], radius: float, segments: int = 16) -> Mesh:
    """A level disc that is seen from above, its picture in metres around its center."""
    angle = np.linspace(0.0, 2 * np.pi, segments, endpoint=False)
    rim = radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    vertices = np.concatenate([np.zeros((1, 3)), rim])
    ring = np.arange(segments)
    faces = np.stack([0 * ring, 1 + ring, 1 + (ring + 1) % segments], axis=-1)
    normals = np.broadcast_to([0.0, 0.0, 1.0], vertices.shape).copy()
    return Mesh(vertices + np.asarray(centre, dtype=float), faces, normals, vertices[:, :2])


def ribbon(
    path: Float[np.ndarray, "points 2"], width: Float[np.ndarray, " points"], z: float
) -> Mesh:
    """A level strip along a path in the plane; u runs along it, v across it from 0."""
    along = _unit(np.gradient(path, axis=0))
    left = np.stack([-along[:, 1], along[:, 0]], axis=-1) * width[:, None] / 2
    flat = np.concatenate([path - left, path + left])
    run = np.append(0.0, np.linalg.norm(np.diff(path, axis=0), axis=1).cumsum())
    uvs = np.stack([np.append(run, run), np.append(0 * run, width)], axis=-1)
    vertices = np.concatenate([flat, np.full((len(flat), 1), z)], axis=1)
    i, n = np.arange(len(path) - 1), len(path)
    faces = np.concatenate(
        [np.stack([i, i + 1, n + i + 1], axis=-1), np.stack([i, n + i + 1, n + i], axis=-1)]
    )
    normals = np.broadcast_to([0.0, 0.0, 1.0], vertices.shape).copy()
    return Mesh(vertices, faces, normals, uvs)


def blob(
    centre: Float[np.ndarray, "3"],
    radii: Float[np.ndarray, "3"],
    rng: np.random.Generator,
    *,
    roughness: float = 0.15,
    rings: int = 6,
) -> Mesh:
    """An ellipsoid with bumps: the inside of a crown, a bush, a stone."""
    polar = np.linspace(0.0, np.pi, rings + 1)[:, None]
    around = np.linspace(0.0, 2 * np.pi, 2 * rings + 1)[None]
    ball = np.stack(
        np.broadcast_arrays(
            np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), -np.cos(polar)
        ),
        axis=-1,
    )
    bumps = 1 + roughness * rng.standard_normal(ball.shape[:2])
    bumps[:, -1] = bumps[:, 0]
    bumps[[0, -1]] = 1.0
    vertices = ball * bumps[..., None] * radii + centre
    normals = _unit((ball / radii).reshape(-1, 3))
    size = float(np.mean(radii))
    uvs = np.stack(np.broadcast_arrays(around * size, polar * size), axis=-1)
    return Mesh(
        vertices.reshape(-1, 3), _grid(rings + 1, 2 * rings + 1), normals, uvs.reshape(-1, 2)
    )


def _grid(rows: int, columns: int) -> Int[np.ndarray, "faces 3"]:
    """Faces of a grid of vertices, seen from the side of (along a row) × (to the next row)."""
    row, column = np.meshgrid(np.arange(rows - 1), np.arange(columns - 1), indexing="ij")
    a = (row * columns + column).reshape(-1)
    b, c, d = a + 1, a + columns + 1, a + columns
    return np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)])


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Like numpy.cross, which spends most of its time on a few vectors with its axes."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def _unit(vectors: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0, length, 1.0)
