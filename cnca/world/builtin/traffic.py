"""Traffic: the built-in vehicles in ordinary paints, parked and driving."""

from __future__ import annotations

from functools import cache

import numpy as np

from cnca.vehicle.builtin.bodywork import Body
from cnca.vehicle.builtin.sedan import body_surfaces
from cnca.vehicle.builtin.shapes import BUILTIN_VEHICLES
from cnca.world.builtin.finishes import FINISHES, PAINTS
from cnca.world.builtin.lamps import vehicle_lamps
from cnca.world.builtin.meshes import Mesh
from cnca.world.builtin.site import Pose, Site
from cnca.world.model import Lamp

SHARES = {"hatchback": 0.33, "suv": 0.27, "sedan": 0.27, "van": 0.09, "pickup": 0.04}
"""Bodies in traffic."""
LABELS = {"van": "truck", "pickup": "truck"}
"""COCO's class of bodies that are not cars: detectors call vans and pickups trucks, or cars."""
_LAMPS = {"light": "lamp_headlight", "tail_light": "lamp_tail"}


@cache
def body(name: str) -> dict[str, Mesh]:
    """Meshes of a built-in vehicle by surface; its paint is called ``paint``."""
    meshes = {}
    for material, surface in body_surfaces(Body(BUILTIN_VEHICLES[name], coarse=True)).items():
        uvs = np.zeros((len(surface.vertices), 2))
        mesh = Mesh(surface.vertices, surface.faces, surface.normals, uvs)
        meshes["paint" if material == "paint" else _LAMPS.get(material, f"car_{material}")] = mesh
    return meshes


def length(name: str) -> float:
    """Of a built-in vehicle, metres."""
    return BUILTIN_VEHICLES[name].length


def draw_body(rng: np.random.Generator) -> str:
    """One of the built-in bodies."""
    return str(rng.choice(list(SHARES), p=list(SHARES.values())))


@cache
def lights(name: str) -> tuple[Lamp, ...]:
    """Of a built-in vehicle that drives at night."""
    meshes = body(name)
    return vehicle_lamps(meshes["lamp_headlight"], meshes["lamp_tail"])


def put_vehicle(
    site: Site,
    rng: np.random.Generator,
    pose: Pose,
    name: str | None = None,
    *,
    drives: bool = False,
) -> str:
    """Put a vehicle that heads along the pose's +x, its middle at the origin; return its name.

    One that ``drives`` has its lights on when lamps are.
    """
    name = name or draw_body(rng)
    shares = np.array([share for share, _ in PAINTS.values()])
    paint = str(rng.choice(list(PAINTS), p=shares / shares.sum()))
    if name == "van" and rng.random() < 0.6:
        paint = "white"
    meshes = {f"paint_{paint}" if s == "paint" else s: mesh for s, mesh in body(name).items()}
    assert all(surface in FINISHES for surface in meshes)
    site.add_object(LABELS.get(name, "car"), meshes, pose)
    for lamp in lights(name) if drives else ():
        site.add_lamp(lamp, pose)
    site.taken.append((pose.x, pose.y))
    return name
