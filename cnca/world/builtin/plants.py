"""Trees, hedges and bushes out of leaves that are triangles: no picture needs a mask."""

from __future__ import annotations

from functools import cache

import numpy as np
from jaxtyping import Float

from cnca.world.builtin.meshes import Mesh, blob, box, merge, quads, tube
from cnca.world.builtin.site import Pose, Site

Points = Float[np.ndarray, "points 3"]
KINDS = 4
"""How many trees are grown; all others are these, turned."""
FAR = 32.0
"""Metres from the world's origin from which a tree has fewer and larger leaves."""


def foliage(
    points: Points, outward: Points, rng: np.random.Generator, size: float, droop: float = 0.25
) -> Mesh:
    """A kite-shaped tuft of leaves at every point, facing outwards more or less.

    ``size`` is the tuft's length in metres.  The normals lean outwards, so that a crown is shaded
    as a whole and yet every tuft differs.
    """
    count = len(points)
    facing = _unit(outward + 0.75 * rng.standard_normal((count, 3)) + [0, 0, droop])
    along = _unit(np.cross(facing, rng.standard_normal((count, 3))))
    across = np.cross(facing, along)
    long = size * rng.uniform(0.6, 1.3, (count, 1))
    wide = 0.34 * long * rng.uniform(0.7, 1.3, (count, 1))
    corners = np.stack(
        [
            points - 0.5 * long * along,
            points + wide * across,
            points + 0.5 * long * along,
            points - wide * across,
        ],
        axis=1,
    )
    # Corners run clockwise about ``facing`` with this order; the faces turn them back.
    first = 4 * np.arange(count)[:, None]
    faces = np.concatenate([first + [0, 3, 2], first + [0, 2, 1]])
    normals = np.repeat(_unit(facing + 0.6 * outward), 4, axis=0)
    at = rng.uniform(0, 1, (count, 1, 2))
    uvs = at + np.array([[0, 0], [0.01, 0.01], [0.02, 0.0], [0.01, -0.01]])
    return Mesh(corners.reshape(-1, 3), faces, normals, uvs.reshape(-1, 2))


@cache
def grown(kind: int, *, near: bool) -> dict[str, Mesh]:
    """A tree of about 9 m at the origin: its surfaces and meshes."""
    rng = np.random.default_rng(100 + kind)
    stem, height, reach = rng.uniform(2.4, 3.0), rng.uniform(8.0, 10.0), rng.uniform(2.0, 2.6)
    t = np.linspace(0, 1, 6)[:, None]
    path = t * [[*rng.normal(0, 0.15, 2), 0.75 * height]]
    wood = [tube(path, np.linspace(0.19, 0.07, 6) + 0.07 * (np.arange(6) == 0), 9)]
    blobs, tufts, size, rings = (19, 160, 0.36, 4) if near else (11, 72, 0.58, 3)
    leaves, cores = [], []
    for number in range(blobs):
        level = (number + rng.uniform()) / blobs
        spread = reach * np.sin(np.pi * (0.20 + 0.70 * level)) ** 0.8
        angle, out = rng.uniform(0, 2 * np.pi), spread * np.sqrt(rng.uniform(0.05, 0.75))
        up = stem + 0.6 + level * (height - stem - 1.3)
        centre = np.array([out * np.cos(angle), out * np.sin(angle), up])
        radii = rng.uniform(0.75, 1.2) * (19 / blobs) ** 0.4 * np.array([1.0, 1.0, 0.8])
        fork = path[2 + int(3 * level)]
        branch = np.stack([fork, (fork + centre) / 2 + [0, 0, -0.1], centre])
        if near:
            wood.append(tube(branch, np.array([0.06, 0.04, 0.02]), 5))
        cores.append(blob(centre, 0.62 * radii, rng, roughness=0.1, rings=rings))
        outward = _unit(rng.standard_normal((tufts, 3)))
        depth = rng.uniform(0.65, 1.12, (tufts, 1))
        leaves.append(foliage(centre + depth * radii * outward, outward, rng, size))
    tone = ("leaves", "leaves_dark", "leaves_light", "leaves")[kind]
    return {"bark": merge(wood), "shade": merge(cores), tone: merge(leaves)}


def tree(site: Site, rng: np.random.Generator, pose: Pose, size: float = 1.0) -> None:
    """One of the grown trees, turned and scaled."""
    turned = pose.then(0.0, 0.0, float(rng.uniform(0, 360)))
    near = bool(np.hypot(pose.x, pose.y) < FAR)
    for surface, mesh in grown(int(rng.integers(KINDS)), near=near).items():
        scaled = Mesh(mesh.vertices * size, mesh.faces, mesh.normals, mesh.uvs)
        site.add(surface, scaled, turned)


def hedge(
    site: Site, rng: np.random.Generator, pose: Pose, length: float, high: float = 0.9
) -> None:
    """A clipped hedge from x = 0 to ``length``, 0.6 m thick."""
    core = box((0.06, -0.22, 0.0), (length - 0.06, 0.22, high - 0.08))
    site.add("shade", core, pose)
    # Far from the middle of the world a hedge has fewer and larger leaves.
    near = bool(np.hypot(pose.x, pose.y) < FAR)
    density, size = (55, 0.17) if near else (18, 0.30)
    count = int(length * (2 * high + 0.6) * density)
    around = rng.uniform(0, 2 * high + 0.6, count)
    x = rng.uniform(0.0, length, count)
    front, back = around < high, around > high + 0.6
    y = np.where(front, -0.28, np.where(back, 0.28, around - high - 0.3))
    z = np.where(front, around, np.where(back, around - high - 0.6, high - 0.02))
    outward = np.stack([0 * x, -1.0 * front + 1.0 * back, 1.0 * ~(front | back)], axis=-1)
    points = np.stack([x, y, z], axis=-1) + rng.normal(0, 0.03, (count, 3))
    site.add("leaves_dark", foliage(points, outward, rng, size), pose)


def bush(site: Site, rng: np.random.Generator, pose: Pose, radius: float = 0.5) -> None:
    """A round bush."""
    radii = radius * np.array([1.0, 1.0, 0.85])
    centre = np.array([0.0, 0.0, 0.7 * radius])
    site.add("shade", blob(centre, 0.85 * radii, rng, rings=5), pose)
    outward = _unit(rng.standard_normal((int(260 * radius), 3)))
    points = centre + rng.uniform(0.85, 1.08, (len(outward), 1)) * radii * outward
    points[:, 2] = np.maximum(points[:, 2], 0.03)
    tone = str(rng.choice(["leaves", "leaves_dark", "leaves_light"]))
    site.add(tone, foliage(points, outward, rng, 0.20), pose)


def tussocks(feet: Float[np.ndarray, "tufts 2"], rng: np.random.Generator) -> Mesh:
    """Tufts of tall grass at points of level ground: six blades of 20 to 50 cm each."""
    feet = np.repeat(feet, 6, axis=0) + rng.normal(0, 0.05, (6 * len(feet), 2))
    count = len(feet)
    angle = rng.uniform(0, 2 * np.pi, count)
    facing = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    across = np.stack([-np.sin(angle), np.cos(angle), 0 * angle], axis=-1)
    high, wide = rng.uniform(0.15, 0.45, (count, 1)), rng.uniform(0.004, 0.012, (count, 1))
    foot = np.concatenate([feet, np.full((count, 1), -0.06)], axis=1)
    lean = 0.4 * high * rng.standard_normal((count, 1)) * facing
    top, middle = foot + lean + high * [0.0, 0.0, 1.0], foot + 0.25 * lean + 0.5 * high * [0, 0, 1]
    corners = np.stack([foot, middle + wide * across, top, middle - wide * across], axis=1)
    return quads(corners, rng.uniform(0, 1, (count, 1, 2)) + 0.01 * np.eye(4)[:, :2])


def _unit(vectors: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0, length, 1.0)
