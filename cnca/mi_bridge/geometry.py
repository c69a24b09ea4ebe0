"""Vehicle, ground and the world around them as a Mitsuba scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from cnca.core.errors import TextureError
from cnca.mi_bridge.lamp_shapes import lamp_shapes
from cnca.mi_bridge.variant import dr, mi
from cnca.mi_bridge.wet import wet_principled
from cnca.mi_bridge.world_shapes import holed_surfaces, make_mesh, world_shapes
from cnca.mi_bridge.xml_world import xml_shapes
from cnca.scene.cameras import View
from cnca.scene.materials import Material
from cnca.vehicle.model import Part, Vehicle
from cnca.world.model import World

GROUND_RADIUS = 2000.0
"""Metres; beyond it the sky map's lower half goes on with the same color."""
ALBEDO_FLOOR = 1e-3
"""Darkest albedo a path sees: at 0 no path would carry the gradient."""

SPECULAR_SAMPLING_RATE = 0.35
"""Share of samples for a gloss lobe, relative to the diffuse lobe."""

WORLD, HOLED, VEHICLE, PROP = range(4)
"""What a surface belongs to: the ground to the world, some of which lets light pass."""


class Geometry:
    """The Mitsuba scene of one vehicle and its props in a world; its only emitters are lamps."""

    def __init__(
        self,
        vehicle: Vehicle,
        ground_albedo: Float[np.ndarray, "3"],
        texture_size: int,
        props: tuple[Part, ...] = (),
        materials: str = "coat",
        glass: str = "pane",
        wetness: float = 0.0,
    ) -> None:
        """
        Args:
            ground_albedo: linear RGB in [0, 1].
            texture_size: texels per side of the texture on everything painted.
            props: other things that stand around; painted ones wear the vehicle's texture.
            materials: model of :class:`cnca.effects.surfaces.MaterialsEffect` for every part.
            glass: likewise; "pane" makes thin panes of what lets light through.
            wetness: of the ground, here and in worlds, in [0, 1].

        Raises:
            TextureError: no part of the vehicle is painted, or a painted part has no UVs.
        """
        parts = (*vehicle.parts, *props)
        painted = [part for part in parts if part.material == "paint"]
        if not painted or any(part.uvs is None for part in painted):
            raise TextureError(f"vehicle {vehicle.name}: no painted part with UV coordinates")
        self.texture_size = texture_size
        white = mi.TensorXf(np.ones((texture_size, texture_size, 3), dtype=np.float32))
        texture = mi.load_dict({"type": "bitmap", "data": white, "format": "variant", "raw": True})
        bsdfs = {
            name: _bsdf(vehicle.material(name), texture if name == "paint" else None, materials)
            for name in sorted({part.material for part in parts})
        }
        panes = [name for name in bsdfs if vehicle.material(name).transmission > 0]
        self._panes = glass == "pane" and bool(panes)
        if self._panes:
            bsdfs |= {name: _pane(vehicle.material(name)) for name in panes}
        self._origin = _middle(vehicle)
        meshes = [
            make_mesh(
                part.name,
                bsdfs[part.material],
                part.vertices - self._origin,
                part.faces,
                part.normals,
                part.uvs,
            )
            for part in parts
        ]
        self._shapes = {f"part_{i}": mesh for i, mesh in enumerate(meshes)}
        self._own = {VEHICLE: meshes[: len(vehicle.parts)], PROP: meshes[len(vehicle.parts) :]}
        self.wetness = wetness
        self.ground = _ground(ground_albedo, wetness)
        self._surround([self.ground])
        self._bitmap, self._texture = texture, mi.traverse(texture)
        self._paint = bsdfs["paint"]

    def _surround(
        self,
        shapes: Sequence[mi.Shape],
        holed: Sequence[mi.Shape] = (),
        lamps: Sequence[mi.Emitter] = (),
    ) -> None:
        around = {f"around_{i}": shape for i, shape in enumerate((*shapes, *holed))}
        beams = [lamp for lamp in lamps if lamp.get_shape() is None]
        around |= {f"beam_{i}": beam for i, beam in enumerate(beams)}
        self.lamps = tuple(lamps)
        self.scene = mi.load_dict({"type": "scene", **self._shapes, **around})
        self.has_holes = bool(holed)
        self.has_panes = self._panes or self.has_holes
        self._kinds = _kinds({**self._own, HOLED: holed})

    def among(
        self,
        shapes: Sequence[mi.Shape],
        holed: Sequence[mi.Shape] = (),
        lamps: Sequence[mi.Emitter] = (),
    ) -> Geometry:
        """The same vehicle and texture among other shapes than the ground, and among lamps."""
        other = copy(self)
        other._surround(shapes, holed, lamps)
        return other

    def within(self, world: World, *, lit: bool = False) -> tuple[Geometry, Geometry]:
        """The vehicle in a world whose places are seen from its middle; and the world without it.

        ``lit`` says whether the world's lamps are on.
        The world's many BSDFs live as long as these: kernels made meanwhile hold the code of all.
        """
        if world.xml is not None:
            loaded = xml_shapes(world.xml, lit=lit)
            solid, holed, lamps = loaded.solid, loaded.holed, loaded.lamps
        else:
            shapes = world_shapes(world, lit=lit, wetness=self.wetness)
            holed = [shapes.pop(name) for name in holed_surfaces(world)]
            squares, lamps = lamp_shapes(world.lamps if lit else ())
            lamps = lamps or [s.emitter() for s in shapes.values() if s.emitter() is not None]
            solid = [*shapes.values(), *squares, *([self.ground] if world.ground else [])]
        bare = copy(self)
        bare._shapes, bare._own, bare._panes = {}, {}, False
        bare._surround(solid, holed, lamps)
        return self.among(solid, holed, lamps), bare

    def local(self, view: View) -> View:
        """The view in this scene's axes, which start in the vehicle's middle on the ground."""
        moved = ((np.array(point) - self._origin).tolist() for point in (view.origin, view.target))
        origin, target = moved
        return replace(view, origin=tuple(origin), target=tuple(target))

    @property
    def vehicle_bounds(self) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        """Lowest and highest corner of the vehicle's box in metres."""
        boxes = [shape.bbox() for shape in self._own[VEHICLE]]
        low = np.min([np.array(box.min) for box in boxes], axis=0)
        return low, np.max([np.array(box.max) for box in boxes], axis=0)

    def bind(self, albedo: mi.TensorXf, *, differentiable: bool = False) -> mi.TensorXf:
        """Make ``albedo`` (size, size, 3), linear, row 0 at v = 1, the paint of the next render.

        The paint is ``albedo`` mapped from [0, 1] to [ALBEDO_FLOOR, 1], so that a black texel still
        scatters paths and so still learns; the image error is below 10⁻³ of the incident light, and
        no real paint is darker.  Returns what was bound, where the gradient gathers.
        """
        bound = ALBEDO_FLOOR + (1 - ALBEDO_FLOOR) * dr.detach(albedo)
        if differentiable:
            dr.enable_grad(bound)
        self._texture["data"] = bound
        self._texture.update()
        return bound

    def paint(self, uv: mi.Point2f, active: mi.Bool) -> mi.Color3f:
        """What is bound, at texture coordinates of a surface."""
        si = dr.zeros(mi.SurfaceInteraction3f)
        si.uv = uv
        return self._bitmap.eval(si, active)

    @property
    def kernel_tables(self) -> list[mi.UInt32]:
        """What kernels read beside the scene."""
        return [self._kinds]

    def is_vehicle(self, si: mi.SurfaceInteraction3f) -> mi.Bool:
        """Which intersections lie on the vehicle."""
        return self._kind(si) == VEHICLE

    def is_surrounded(self, si: mi.SurfaceInteraction3f) -> mi.Bool:
        """Which intersections lie on the vehicle or on its props: not on the ground or world."""
        return self._kind(si) >= VEHICLE

    def is_holed(self, si: mi.SurfaceInteraction3f) -> mi.Bool:
        """Which intersections lie on surfaces of the world that have holes."""
        return self._kind(si) == HOLED

    def _kind(self, si: mi.SurfaceInteraction3f) -> mi.UInt32:
        number = dr.reinterpret_array(mi.UInt32, si.shape)
        known = si.is_valid() & (number < dr.width(self._kinds))
        return dr.gather(mi.UInt32, self._kinds, number, known)

    def is_painted(self, si: mi.SurfaceInteraction3f) -> mi.Bool:
        """Which intersections wear the texture."""
        return si.is_valid() & (si.bsdf() == mi.BSDFPtr(self._paint))


def _ground(albedo: Float[np.ndarray, "3"], wetness: float) -> mi.Shape:
    reflectance = {"type": "rgb", "value": [float(c) for c in albedo]}
    bsdf: dict[str, object] = {"type": "diffuse", "reflectance": reflectance}
    if wetness > 0:
        dry = {"type": "principled", "base_color": reflectance, "roughness": 1.0}
        bsdf = wet_principled(dry, wetness)
    return mi.load_dict(
        {
            "type": "disk",
            "to_world": mi.ScalarTransform4f().scale([GROUND_RADIUS, GROUND_RADIUS, 1]),
            "bsdf": bsdf,
        }
    )


def _kinds(shapes_of: Mapping[int, Sequence[mi.Shape]]) -> mi.UInt32:
    """Mitsuba's number of a shape → what it belongs to."""
    kinds = {
        int(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape))[0]): kind
        for kind, shapes in shapes_of.items()
        for shape in shapes
    }
    table = np.full(max(kinds, default=0) + 1, WORLD, np.uint32)
    table[list(kinds)] = list(kinds.values())
    return mi.UInt32(table)


def _bsdf(material: Material, texture: mi.Texture | None, model: str) -> mi.BSDF:
    """A principled BSDF; two-sided because meshes of unknown origin have flipped panels."""
    color = texture or {"type": "rgb", "value": list(material.base_color)}
    if model == "diffuse":
        return mi.load_dict({"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": color}})
    principled = {
        "type": "principled",
        "base_color": color,
        "roughness": material.roughness,
        "specular": material.specular,
        "metallic": material.metallic,
        # Sample lobes by what they reflect: a paint's diffuse part outweighs its gloss.
        "diffuse_reflectance_sampling_rate": 1.0,
        "main_specular_sampling_rate": SPECULAR_SAMPLING_RATE,
        "clearcoat_sampling_rate": SPECULAR_SAMPLING_RATE,
    }
    if material.clearcoat > 0 and model == "coat":
        principled |= {
            "clearcoat": material.clearcoat,
            "clearcoat_gloss": material.clearcoat_gloss,
        }
    return mi.load_dict({"type": "twosided", "bsdf": principled})


def _pane(material: Material) -> mi.BSDF:
    """Glass so thin that light leaves it where it came in, with all reflections between its sides.

    Its index of refraction is that of the principled model's ``specular``.
    """
    root = (0.08 * material.specular) ** 0.5
    return mi.load_dict(
        {
            "type": "thindielectric",
            "int_ior": (1 + root) / (1 - root),
            "specular_transmittance": material.transmission,
        }
    )


def _middle(vehicle: Vehicle) -> Float[np.ndarray, "3"]:
    """The middle of the vehicle's ground plan; float32 is too coarse for one a long way off."""
    if not vehicle.parts:
        return np.zeros(3)
    vertices = np.concatenate([part.vertices for part in vehicle.parts])[:, :2]
    return np.array([*(vertices.min(axis=0) + vertices.max(axis=0)) / 2, 0.0])
