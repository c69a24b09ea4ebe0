"""Triangle surfaces that are made from grids and cut along level sets.

A car body is one smooth closed skin; windows, lights and gaps are cut out of it where a signed
distance changes its sign.  The cut runs exactly along the level set (linear inside a triangle, as
in marching triangles), so outlines are smooth however coarse the mesh is, and pieces fit together
without a gap or an overlap.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int


@dataclass(frozen=True)
class Surface:
    """Triangles, counter-clockwise seen from outside, with unit normals per vertex; metres."""

    vertices: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]
    normals: Float[np.ndarray, "vertices 3"]

    @classmethod
    def smooth(
        cls, vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
    ) -> Surface:
        """A surface with area-weighted vertex normals; equal vertices (to 1 µm) are welded."""
        _, first, same = np.unique(
            vertices.round(6), axis=0, return_index=True, return_inverse=True
        )
        vertices, faces = vertices[first], same.ravel()[faces]
        # Faces without area stay as long as they close the gap between three points in a row.
        faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
        crosses = face_crosses(vertices, faces)
        normals = np.zeros_like(vertices)
        for corner in range(3):
            np.add.at(normals, faces[:, corner], crosses)
        return cls(vertices, faces, _unit(normals)).compact()

    @property
    def x(self) -> Float[np.ndarray, " vertices"]:
        """Forward coordinates."""
        return self.vertices[:, 0]

    @property
    def y(self) -> Float[np.ndarray, " vertices"]:
        """Leftward coordinates."""
        return self.vertices[:, 1]

    @property
    def z(self) -> Float[np.ndarray, " vertices"]:
        """Heights."""
        return self.vertices[:, 2]

    def split(self, distance: Float[np.ndarray, " vertices"]) -> tuple[Surface, Surface]:
        """Cut along ``distance`` = 0; return what is inside (negative) and what is outside."""
        # A vertex on the level set would be cut off as a triangle without area.
        distance = np.where(np.abs(distance) < 1e-7, 1e-7, distance)
        inside = distance < 0
        count = inside[self.faces].sum(axis=1)
        tip, left, right = _alone_first(self.faces[(count == 1) | (count == 2)], inside).T

        # Neighbors share the new vertex on their common edge.
        edges = np.sort(np.stack([np.append(tip, tip), np.append(left, right)], axis=1), axis=1)
        keys, index = np.unique(edges, axis=0, return_inverse=True)
        a, b = keys.T
        t = (distance[a] / (distance[a] - distance[b]))[:, None]
        vertices = np.concatenate([self.vertices, _mix(self.vertices, a, b, t)])
        normals = np.concatenate([self.normals, _unit(_mix(self.normals, a, b, t))])
        p, q = len(self.vertices) + index.reshape(2, -1)
        tips = np.stack([tip, p, q], axis=1)
        bases = np.stack([p, left, right, p, right, q], axis=1).reshape(-1, 2, 3)

        def piece(whole: int, has_tip: Bool[np.ndarray, " cut"]) -> Surface:
            kept = self.faces[count == whole], tips[has_tip], bases[~has_tip].reshape(-1, 3)
            return Surface(vertices, np.concatenate(kept), normals).compact()

        return piece(3, inside[tip]), piece(0, ~inside[tip])

    def compact(self) -> Surface:
        """The same surface without the vertices that no face uses."""
        used, faces = np.unique(self.faces, return_inverse=True)
        return Surface(self.vertices[used], faces.reshape(-1, 3), self.normals[used])

    def moved(self, offset: Sequence[float]) -> Surface:
        """The surface shifted by ``offset`` metres."""
        return Surface(self.vertices + np.asarray(offset), self.faces, self.normals)

    def mirrored(self) -> Surface:
        """The surface on the other side of the plane y = 0."""
        flip = np.array([1.0, -1.0, 1.0])
        return Surface(self.vertices * flip, self.faces[:, ::-1], self.normals * flip)

    def boundary(self) -> Int[np.ndarray, "edges 2"]:
        """Edges that belong to one face only, in the direction in which that face runs."""
        edges = self.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        _, inverse, counts = np.unique(
            np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True
        )
        return edges[counts[inverse.ravel()] == 1]

    def recessed(self, offset: Sequence[float]) -> Surface:
        """The surface shifted by ``offset`` metres, with walls from its old edge to its new one."""
        edges = self.boundary()
        vertices = np.concatenate([self.vertices, self.vertices + np.asarray(offset)])
        (a, b), count = edges.T, len(self.vertices)
        walls = np.concatenate(
            [np.stack([a, b, b + count]), np.stack([a, b + count, a + count])], 1
        )
        return join([self.moved(offset), Surface.smooth(vertices, walls.T)])


def join(surfaces: Sequence[Surface]) -> Surface:
    """All the surfaces as one; nothing is welded."""
    starts = np.cumsum([0] + [len(s.vertices) for s in surfaces[:-1]])
    return Surface(
        np.concatenate([s.vertices for s in surfaces]),
        np.concatenate([s.faces + start for s, start in zip(surfaces, starts, strict=True)]),
        np.concatenate([s.normals for s in surfaces]),
    )


def grid_faces(rows: int, columns: int) -> Int[np.ndarray, "faces 3"]:
    """Two triangles per cell of a grid of vertices in row-major order whose columns close a ring.

    They are counter-clockwise seen from the side where (next row) × (next column) points.
    """
    row, column = np.meshgrid(np.arange(rows - 1), np.arange(columns), indexing="ij")
    a, b = row * columns + column, row * columns + (column + 1) % columns
    c, d = a + columns, b + columns
    return np.stack([a, c, d, a, d, b], axis=-1).reshape(-1, 3)


def revolved(profile: Float[np.ndarray, "points 2"], segments: int = 48) -> Surface:
    """Turn a profile of (radius, y) points about the y axis.

    The profile runs counter-clockwise around its material with radius to the right, y upwards:
    outwards on the −y side, back to the axis on the +y side.
    """
    # The first meridian points down, so that a wheel touches the ground with a vertex.
    angle = np.linspace(0.0, 2 * np.pi, segments, endpoint=False) - np.pi / 2
    radius, y = profile[:, :1], np.broadcast_to(profile[:, 1:], (len(profile), segments))
    vertices = np.stack([radius * np.cos(angle), y, radius * np.sin(angle)], axis=-1)
    return Surface.smooth(vertices.reshape(-1, 3), grid_faces(len(profile), segments))


def ellipsoid(centre: Sequence[float], radii: Sequence[float], rings: int = 8) -> Surface:
    """An ellipsoid with axes along x, y and z; metres."""
    angle = np.linspace(0.0, np.pi, rings + 1)
    ball = revolved(np.stack([np.sin(angle), -np.cos(angle)], axis=1), 2 * rings)
    normals = _unit(ball.vertices / np.asarray(radii))
    return Surface(ball.vertices * np.asarray(radii) + np.asarray(centre), ball.faces, normals)


def face_crosses(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> Float[np.ndarray, "faces 3"]:
    """Outward vectors with twice the area of each face as their length."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    return np.cross(b - a, c - a)


def _alone_first(
    faces: Int[np.ndarray, "cut 3"], inside: Bool[np.ndarray, " vertices"]
) -> Int[np.ndarray, "cut 3"]:
    """Turn each face so that the vertex that is alone on its side comes first."""
    sides = inside[faces]
    alone = np.argmax(sides == (sides.sum(axis=1) == 1)[:, None], axis=1)
    return np.take_along_axis(faces, (alone[:, None] + np.arange(3)) % 3, axis=1)


def _mix(
    values: Float[np.ndarray, "vertices 3"],
    a: Int[np.ndarray, " new"],
    b: Int[np.ndarray, " new"],
    t: Float[np.ndarray, "new 1"],
) -> Float[np.ndarray, "new 3"]:
    return (1 - t) * values[a] + t * values[b]


def _unit(vectors: Float[np.ndarray, "vectors 3"]) -> Float[np.ndarray, "vectors 3"]:
    """Vectors of length 1; a zero vector (a vertex without faces) stays zero."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(length > 0, length, 1.0)
