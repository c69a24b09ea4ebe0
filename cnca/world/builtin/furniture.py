"""Lamps, signs, bins, benches, bollards and fences."""

from __future__ import annotations

import numpy as np

from cnca.world.builtin.glazing_pictures import SIGNS
from cnca.world.builtin.lamps import luminaire
from cnca.world.builtin.meshes import Mesh, box, disc, merge, quads, repeat, tube
from cnca.world.builtin.site import Pose, Site

ALL_SIDES = "-x+x-y+y+z-z"


def street_lamp(site: Site, pose: Pose, height: float = 7.5, reach: float = 1.8) -> None:
    """A post whose arm reaches along −y over the carriageway."""
    post = np.array([[0, 0, 0], [0, 0, 0.9], [0, 0, 0.95], [0, 0, height - 0.6]], dtype=float)
    t = np.linspace(0, 1, 7)[:, None]
    foot, corner = np.array([0, 0, height - 0.6]), np.array([0, 0, height])
    arm = (1 - t) ** 2 * foot + 2 * t * (1 - t) * corner + t**2 * np.array([0, -reach, height])
    metal = [tube(post, np.array([0.09, 0.09, 0.065, 0.05]), 10), tube(arm, np.full(7, 0.04), 8)]
    head = ((-0.13, -reach - 0.55, height - 0.04), (0.13, -reach + 0.05, height + 0.09))
    metal.append(box(*head))
    site.add("steel", merge(metal), pose)
    glass = box(
        (-0.10, -reach - 0.5, height - 0.07), (0.10, -reach, height - 0.035), sides="-x+x-y+y-z"
    )
    site.add("lamp_glass", glass, pose)
    site.add_lamp(luminaire((0.0, -reach - 0.25, height - 0.08)), pose)


def hanging_lamp(site: Site, pose: Pose, half: float, height: float = 7.5) -> None:
    """A lamp on a wire across the road, ``half`` the wire's length to each side of the pose."""
    wire = np.array([[0, -half, height + 0.6], [0, 0, height + 0.2], [0, half, height + 0.6]])
    site.add("steel_dark", tube(wire.astype(float), np.full(3, 0.008), 4), pose)
    site.add("steel", box((-0.28, -0.16, height), (0.28, 0.16, height + 0.18)), pose)
    site.add_lamp(luminaire((0.0, 0.0, height - 0.02)), pose)


def traffic_sign(site: Site, pose: Pose, kind: str, height: float = 2.2) -> None:
    """A sign on a post; its face looks along −y, its lower edge is ``height`` metres up."""
    post = np.array([[0, 0.03, 0], [0, 0.03, height + 0.6]])
    site.add("steel", tube(post, np.array([0.03, 0.03]), 8), pose)
    size, middle = 0.30, height + 0.30
    if kind in ("speed", "no_parking"):
        angle = np.linspace(0, 2 * np.pi, 17)[:-1]
        flat = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    elif kind == "yield":
        flat = np.array([[0.0, -1.0], [1.0, 0.75], [-1.0, 0.75]])
    else:
        flat = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    column = SIGNS.index(kind)
    uvs = np.stack(
        [(column + 0.5 + 0.49 * flat[:, 0]) / len(SIGNS), 0.5 + 0.49 * flat[:, 1]], axis=-1
    )
    site.add("sign", _plate(size * flat, middle, uvs), pose)
    plate = _plate(size * flat[::-1], middle, uvs)
    site.add(
        "steel", Mesh(plate.vertices + [0, 0.004, 0], plate.faces, -plate.normals, plate.uvs), pose
    )


def _plate(flat: np.ndarray, middle: float, uvs: np.ndarray) -> Mesh:
    """A polygon in the plane y = 0, counter-clockwise for one who looks along +y."""
    vertices = np.stack([flat[:, 0], 0 * flat[:, 0], middle + flat[:, 1]], axis=-1)
    i = np.arange(1, len(flat) - 1)
    faces = np.stack([0 * i, i, i + 1], axis=-1)
    normals = np.broadcast_to([0.0, -1.0, 0.0], vertices.shape).copy()
    return Mesh(vertices, faces, normals, uvs)


def bin_(site: Site, pose: Pose) -> None:
    """A litter bin on the pavement."""
    wall = tube(np.array([[0, 0, 0.08], [0, 0, 0.85]]), np.array([0.19, 0.22]), 12)
    site.add("bin", merge([wall, disc((0, 0, 0.80), 0.21, 12)]), pose)
    site.add(
        "steel_dark", tube(np.array([[0, 0, 0], [0, 0, 0.1]]), np.array([0.05, 0.05]), 8), pose
    )


def wheelie_bin(site: Site, pose: Pose) -> None:
    """A household bin with a lid."""
    body = box((-0.28, -0.3, 0.05), (0.28, 0.3, 1.0))
    lid = box((-0.30, -0.34, 1.0), (0.30, 0.32, 1.07), sides=ALL_SIDES)
    site.add("bin", merge([body, lid]), pose)


def bench(site: Site, pose: Pose) -> None:
    """A wooden bench that looks along −y."""
    planks = [
        box((-0.9, y, 0.42), (0.9, y + 0.11, 0.46), sides=ALL_SIDES) for y in (-0.25, -0.12, 0.01)
    ]
    planks += [box((-0.9, 0.17, z), (0.9, 0.20, z + 0.11), sides=ALL_SIDES) for z in (0.55, 0.70)]
    site.add("timber", merge(planks), pose)
    legs = [box((x - 0.03, -0.22, 0.0), (x + 0.03, 0.17, 0.42)) for x in (-0.7, 0.7)]
    legs += [box((x - 0.03, 0.12, 0.42), (x + 0.03, 0.17, 0.82)) for x in (-0.7, 0.7)]
    site.add("steel_dark", merge(legs), pose)


def bollards(site: Site, pose: Pose, length: float, step: float = 1.6) -> None:
    """A row of posts from x = 0 to ``length``."""
    posts = []
    for x in np.arange(0.0, length + 1e-6, step):
        post = np.array([[x, 0, 0], [x, 0, 0.88], [x, 0, 0.92]])
        posts += [tube(post, np.array([0.055, 0.055, 0.03]), 8), disc((x, 0, 0.92), 0.03, 8)]
    site.add("steel_dark", merge(posts), pose)


def railing(site: Site, pose: Pose, length: float, high: float = 0.95) -> None:
    """A fence of iron bars from x = 0 to ``length`` on a low wall."""
    wall = box((0, -0.12, 0), (length, 0.12, 0.28))
    site.add("ashlar_grey", wall, pose)
    bars = _row(box((0, -0.01, 0.28), (0.02, 0.01, high), sides="-y+y"), 0.06, length, 0.13)
    rails = [
        box((0, -0.02, z), (length, 0.02, z + 0.03), sides=ALL_SIDES) for z in (0.36, high - 0.12)
    ]
    site.add("steel_dark", merge([bars, *rails]), pose)


def picket_fence(site: Site, pose: Pose, length: float, high: float = 0.85) -> None:
    """A fence of boards from x = 0 to ``length``."""
    board = box((0, -0.01, 0.08), (0.08, 0.01, high), sides="-x+x-y+y+z")
    boards = _row(board, 0.0, length - 0.08, 0.15)
    rails = [
        box((0, 0.01, z), (length, 0.05, z + 0.07), sides=ALL_SIDES) for z in (0.25, high - 0.2)
    ]
    site.add("timber", merge([boards, *rails]), pose)


def _row(mesh: Mesh, start: float, end: float, step: float) -> Mesh:
    x = np.arange(start, end, step)
    return repeat(mesh, np.stack([x, 0 * x, 0 * x], axis=-1))


def traffic_light(site: Site, pose: Pose) -> None:
    """A signal on a post that looks along −y, as something that detectors know."""
    post = tube(np.array([[0, 0.12, 0], [0, 0.12, 3.3]]), np.array([0.07, 0.055]), 10)
    site.add("steel", post, pose)
    meshes = {"steel_dark": box((-0.16, -0.1, 2.35), (0.16, 0.12, 3.25), sides=ALL_SIDES)}
    for number, color in enumerate(("lamp_green", "lamp_amber", "lamp_red")):
        face = disc((0, 0, 0), 0.10, 14)
        upright = np.stack(
            [face.vertices[:, 0], 0 * face.vertices[:, 0] - 0.105, face.vertices[:, 1]], axis=-1
        )
        centre = upright + [0, 0, 2.52 + 0.28 * number]
        normals = np.broadcast_to([0.0, -1.0, 0.0], centre.shape).copy()
        meshes[color] = Mesh(centre, face.faces, normals, face.uvs)
    site.add_object("traffic light", meshes, pose)


def planter(site: Site, pose: Pose, length: float = 1.2) -> None:
    """A concrete trough, to be planted."""
    site.add("concrete", box((0, -0.3, 0), (length, 0.3, 0.45), sides="-x+x-y+y"), pose)
    site.add(
        "soil",
        quads(
            np.array([[[0, -0.3, 0.42], [length, -0.3, 0.42], [length, 0.3, 0.42], [0, 0.3, 0.42]]])
        ),
        pose,
    )
