"""Things that are not vehicles: boxes, barrels, poles, cones and balls with texture coordinates."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from cnca.vehicle.model import Part

SEGMENTS = 24


def box(size: Float[np.ndarray, "3"]) -> Part:
    """A box on the ground, its texture wrapped around the four walls and repeated on the lid."""
    walls = [((1, 0), (0, -1)), ((0, 1), (1, 0)), ((-1, 0), (0, 1)), ((0, -1), (-1, 0))]
    vertices, normals, uvs = [], [], []
    for i, (outward, along) in enumerate(walls):
        for s, t in ((-1, 0), (1, 0), (1, 1), (-1, 1)):
            vertices.append([(outward[0] - s * along[0]) / 2, (outward[1] - s * along[1]) / 2, t])
            normals.append([*outward, 0])
            uvs.append([(i + (s + 1) / 2) / 4, 0.75 * t])
    for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        vertices.append([x / 2, y / 2, 1])
        normals.append([0, 0, 1])
        uvs.append([(x + 1) / 2, 0.75 + (y + 1) / 8])
    faces = [
        [4 * f + a, 4 * f + b, 4 * f + c] for f in range(5) for a, b, c in ((0, 1, 2), (0, 2, 3))
    ]
    return _part("box", np.array(vertices) * size, faces, np.array(normals), np.array(uvs))


def revolved(name: str, profile: Float[np.ndarray, "rings 2"]) -> Part:
    """A surface of revolution from (radius, height) pairs, bottom first."""
    angle = np.linspace(0, 2 * np.pi, SEGMENTS + 1)
    v = np.linspace(0, 1, len(profile))
    radius, height = profile[:, 0, None], profile[:, 1, None]
    vertices = np.stack(
        [
            radius * np.cos(angle),
            radius * np.sin(angle),
            np.broadcast_to(height, (len(v), len(angle))),
        ],
        axis=-1,
    )
    slope = np.gradient(profile, axis=0)
    outward, upward = slope[:, 1, None], -slope[:, 0, None]
    normals = np.stack(
        [
            outward * np.cos(angle),
            outward * np.sin(angle),
            np.broadcast_to(upward, vertices.shape[:2]),
        ],
        axis=-1,
    )
    uvs = np.stack(np.broadcast_arrays(angle / (2 * np.pi), v[:, None]), axis=-1)
    row = SEGMENTS + 1
    faces = []
    for i in range(len(v) - 1):
        for j in range(SEGMENTS):
            a, b = i * row + j, i * row + j + 1
            faces += [[a, b, b + row], [a, b + row, a + row]]
    return _part(name, vertices.reshape(-1, 3), faces, normals.reshape(-1, 3), uvs.reshape(-1, 2))


def cylinder(radius: float, height: float) -> Part:
    """A barrel or a pole with a lid."""
    rim = 0.98 * radius
    return revolved(
        "cylinder", np.array([[radius, 0], [radius, height * 0.99], [rim, height], [0, height]])
    )


def cone(radius: float, height: float) -> Part:
    """A traffic cone or a tree's crown."""
    return revolved("cone", np.array([[radius, 0], [radius / 2, height / 2], [0, height]]))


def ball(radius: float) -> Part:
    """A sphere that lies on the ground."""
    t = np.linspace(-np.pi / 2, np.pi / 2, 13)
    return revolved("ball", radius * np.stack([np.cos(t), 1 + np.sin(t)], axis=-1))


def placed(part: Part, material: str, position: tuple[float, float], heading: float) -> Part:
    """The part in another material, turned by ``heading`` (radians) and moved to (x, y) metres."""
    c, s = np.cos(heading), np.sin(heading)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return Part(
        part.name,
        material,
        part.vertices @ turn.T + [*position, 0],
        part.faces,
        part.normals @ turn.T,
        part.uvs,
    )


def draw_prop(rng: np.random.Generator) -> Part:
    """A random shape, in size between a suitcase and a small house."""
    makers: list[Callable[[], Part]] = [
        lambda: box(rng.uniform([0.5, 0.5, 0.4], [5.5, 2.5, 3.0])),
        lambda: cylinder(rng.uniform(0.08, 1.2), rng.uniform(0.5, 4.0)),
        lambda: cone(rng.uniform(0.2, 1.5), rng.uniform(0.5, 4.0)),
        lambda: ball(rng.uniform(0.3, 1.4)),
    ]
    return makers[rng.choice(len(makers), p=[0.5, 0.2, 0.15, 0.15])]()


def _part(
    name: str, vertices: np.ndarray, faces: list[list[int]], normals: np.ndarray, uvs: np.ndarray
) -> Part:
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where(length > 0, normals / np.maximum(length, 1e-12), [0.0, 0.0, 1.0])
    return Part(name, "paint", vertices, np.array(faces), normals, uvs)
