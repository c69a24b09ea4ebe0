"""A world as arrays: what stands around the vehicle, and where in it a vehicle may stand."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, Int, UInt8

from cnca.scene.materials import LinearRgb
from cnca.world.mitsuba_xml import MitsubaXml


@dataclass(frozen=True)
class Surface:
    """How a piece of the world reflects or emits light (Disney's principled model)."""

    base_color: LinearRgb = (0.5, 0.5, 0.5)
    """Linear reflectance in [0, 1]; a factor on ``texture`` where there is one."""
    texture: UInt8[np.ndarray, "height width 3"] | None = None
    """sRGB picture of the reflectance, row 0 on top (v = 1), repeated beyond [0, 1]."""
    opacity: UInt8[np.ndarray, "height width"] | None = None
    """Mask in the same coordinates: 0 is a hole, 255 solid, such as the leaves of a tree."""
    roughness: float = 0.8
    specular: float = 0.5
    metallic: float = 0.0
    clearcoat: float = 0.0
    soaks: bool = False
    """Whether it soaks up water, as grass does: wet it is darker but does not shine."""
    emission: LinearRgb = (0.0, 0.0, 0.0)
    """Radiance in the units of the sky (W/m²/nm/sr) while the world's lamps are on."""
    glow: UInt8[np.ndarray, "height width 3"] | None = None
    """sRGB picture that is a factor on ``emission``, such as rooms behind windows."""

    @property
    def glows(self) -> bool:
        """Whether it emits light."""
        return max(self.emission) > 0


@dataclass(frozen=True)
class Piece:
    """One mesh of one surface; metres, right-handed, +z up."""

    name: str
    surface: str
    """A key of :attr:`World.surfaces`."""
    vertices: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]
    """Counter-clockwise seen from outside."""
    normals: Float[np.ndarray, "vertices 3"]
    """Unit shading normals pointing outwards."""
    uvs: Float[np.ndarray, "vertices 2"] | None = None
    """Texture coordinates, v upwards, repeated beyond [0, 1]; needed where there is a picture."""


@dataclass(frozen=True)
class Place:
    """Where a vehicle may stand: a point of the road's surface, and where it heads."""

    x: float
    y: float
    z: float = 0.0
    heading: float = 0.0
    """Degrees counter-clockwise from +x, seen from above."""


@dataclass(frozen=True)
class Lamp:
    """A square lamp that shines to one side; what holds it are pieces of the world."""

    position: tuple[float, float, float]
    direction: tuple[float, float, float]
    """Unit vector of its axis."""
    intensity: LinearRgb
    """Along the axis, in W/nm/sr: candelas over :data:`cnca.core.photometry.CANDELAS`."""
    side: float
    """Side of the square, metres."""
    beam: tuple[float, float] | None = None
    """Degrees off the axis where a reflector's beam begins to fall, and where it ends; without one
    the intensity falls as the cosine (Lambert)."""


@dataclass(frozen=True)
class WorldObject:
    """Something with a label that a detector may find, such as a parked car."""

    label: str
    """The class that it belongs to: car, truck, bus, person, traffic light …"""
    pieces: tuple[int, ...]
    """Indices into :attr:`World.pieces`."""


@dataclass(frozen=True)
class World:
    """Everything around the vehicle, itself not included."""

    name: str
    pieces: tuple[Piece, ...]
    surfaces: Mapping[str, Surface]
    objects: tuple[WorldObject, ...] = ()
    places: tuple[Place, ...] = (Place(0.0, 0.0),)
    """Where the vehicle may stand, in the world's own axes; the first is the usual one."""
    lamps: tuple[Lamp, ...] = ()
    ground: bool = False
    """Whether endless flat ground lies under it at z = 0; else its own pieces are the ground."""
    source: Mapping[str, str] = field(default_factory=dict)
    """Files that it was made of → SHA-256, for manifests and the keys of kept pictures."""
    xml: MitsubaXml | None = None
    """The scene of Mitsuba's that it is; then its pieces only say where things stand."""

    @property
    def lamp_count(self) -> int:
        """How many lamps there are; surfaces that glow count as one."""
        if self.xml is not None:
            return self.xml.lamps
        return len(self.lamps) or int(any(surface.glows for surface in self.surfaces.values()))

    def around(self, place: Place) -> World:
        """The world moved so that ``place`` is the origin and heads along +x."""
        angle = math.radians(-place.heading)
        c, s = math.cos(angle), math.sin(angle)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        foot = np.array([place.x, place.y, place.z])
        moved = tuple(
            replace(
                piece, vertices=(piece.vertices - foot) @ turn.T, normals=piece.normals @ turn.T
            )
            for piece in self.pieces
        )
        places = []
        for other in self.places:
            x, y, z = (turn @ (np.array([other.x, other.y, other.z]) - foot)).tolist()
            places.append(Place(x, y, z, other.heading - place.heading))
        lamps = tuple(
            replace(
                lamp,
                position=tuple((turn @ (np.array(lamp.position) - foot)).tolist()),
                direction=tuple((turn @ np.array(lamp.direction)).tolist()),
            )
            for lamp in self.lamps
        )
        xml = self.xml
        if xml is not None:
            to_here = np.eye(4)
            to_here[:3, :3], to_here[:3, 3] = turn, -turn @ foot
            xml = replace(xml, to_here=to_here @ xml.to_here)
        return replace(self, pieces=moved, places=tuple(places), lamps=lamps, xml=xml)
