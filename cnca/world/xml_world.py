"""A world from a scene in Mitsuba's XML: its shapes as triangles, to stand on and to look past."""

from __future__ import annotations

import hashlib
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh

from cnca.core.errors import MeshError
from cnca.vehicle.mesh.load_mesh import to_our_axes
from cnca.world.mitsuba_xml import numbers, read_mitsuba_xml, to_world
from cnca.world.model import Piece, Place, Surface, World

UP = "y"
"""The usual upward axis of Mitsuba's scenes."""


def load_xml_world(path: Path, *, up: str | None = None, scale: float = 1.0) -> World:
    """Read a scene and turn it to +z up, in metres.

    Its materials stay Mitsuba's.  Shapes that are no triangles are approximated here, where only
    their place counts; kinds that have none, such as hair, are looked past.

    Raises MeshError for what cannot be read, and for a scene without shapes.
    """
    xml = read_mitsuba_xml(path)
    up = up or UP
    to_ours = np.eye(4)
    to_ours[:3, :3] = scale * to_our_axes(path, up, "+y" if up == "x" else "+x")
    pieces = []
    for number, shape in enumerate(xml.root.findall("shape")):
        mesh = _mesh(path, shape)
        if mesh is not None and len(mesh.faces):
            name = shape.get("id") or f"{shape.get('type', 'shape')}_{number}"
            pieces.append(_piece(name, mesh.apply_transform(to_ours)))
    if not pieces:
        raise MeshError(f"{path}: holds no shapes that a vehicle can stand among")
    source = {str(file): hashlib.sha256(file.read_bytes()).hexdigest() for file in xml.files}
    xml = replace(xml, to_here=to_ours)
    surfaces = {"xml": Surface()}
    places = (Place(0.0, 0.0),)
    return World(path.stem, tuple(pieces), surfaces, places=places, source=source, xml=xml)


def _piece(name: str, mesh: trimesh.Trimesh) -> Piece:
    vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces)
    return Piece(name, "xml", vertices, faces, np.asarray(mesh.vertex_normals, float))


def _mesh(path: Path, shape: ET.Element) -> trimesh.Trimesh | None:
    """The shape in its file's axes."""
    kind = shape.get("type", "")
    try:
        if kind in ("obj", "ply"):
            file = _value(shape, "string", "filename")
            mesh = trimesh.load_mesh(file, process=False)
        elif kind == "rectangle":
            corners = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
            mesh = trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)
        elif kind == "cube":
            mesh = trimesh.creation.box((2, 2, 2))
        elif kind == "sphere":
            mesh = trimesh.creation.icosphere(2, float(_value(shape, "float", "radius") or 1))
            mesh.apply_translation(_point(shape, "center", (0, 0, 0)))
        elif kind == "disk":
            mesh = trimesh.creation.cylinder(1.0, 1e-6)
        elif kind == "cylinder":
            ends = [_point(shape, "p0", (0, 0, 0)), _point(shape, "p1", (0, 0, 1))]
            mesh = trimesh.creation.cylinder(
                float(_value(shape, "float", "radius") or 1), segment=ends
            )
        else:
            return None
        return mesh.apply_transform(to_world(shape))
    except Exception as error:  # trimesh's readers raise whatever a broken file makes them raise
        reason = " ".join(str(error).split()) or type(error).__name__
        raise MeshError(f"{path}: a shape of type {kind} cannot be read ({reason})") from None


def _value(shape: ET.Element, tag: str, name: str) -> str:
    found = (e.get("value", "") for e in shape.findall(tag) if e.get("name") == name)
    return next(found, "")


def _point(
    shape: ET.Element, name: str, otherwise: tuple[float, float, float]
) -> tuple[float, float, float]:
    return next((numbers(p) for p in shape.findall("point") if p.get("name") == name), otherwise)
