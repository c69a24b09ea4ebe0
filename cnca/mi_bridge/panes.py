"""What light passes without being bent: thin panes of glass, and the holes between leaves."""

from __future__ import annotations

from cnca.mi_bridge.geometry import Geometry
from cnca.mi_bridge.variant import dr, mi

MOST_PANES = 8
"""Thin panes of glass that a path may pass; light behind more of them is lost."""
MOST_HOLES = 32
"""Holes in leaves that a camera ray may pass."""


@dr.syntax
def pane_transmittance(
    scene: mi.Scene, ray: mi.Ray3f, active: mi.Bool, end: mi.Point3f | None = None
) -> mi.Color3f:
    """Share of light that comes along ``ray`` through panes, from infinity or from its ``end``.

    It is 0 behind everything else.
    """
    T = mi.Color3f(1)
    panes = mi.UInt32(0)
    active = mi.Bool(active)
    while dr.hint(active, label="panes"):
        si = scene.ray_intersect(ray, active)
        hit = active & si.is_valid()
        T = dr.select(hit, T * si.bsdf(ray).eval_null_transmission(si, hit), T)
        T = dr.select(hit & (panes == MOST_PANES), 0, T)
        active = hit & (dr.max(T) > 0)
        ray = si.spawn_ray(ray.d) if end is None else si.spawn_ray_to(end)
        panes += 1
    return T


def sees_vehicle(geometry: Geometry, ray: mi.Ray3f) -> mi.Bool:
    """Whether the vehicle is the first thing on a ray that is no hole in a leaf."""
    si = geometry.scene.ray_intersect(ray)
    return geometry.is_vehicle(_behind_holes(geometry, ray, si) if geometry.has_holes else si)


@dr.syntax
def _behind_holes(
    geometry: Geometry, ray: mi.Ray3f, si: mi.SurfaceInteraction3f
) -> mi.SurfaceInteraction3f:
    """The first surface whose opacity is at least one half."""
    active = geometry.is_holed(si)
    passed = mi.UInt32(0)
    while dr.hint(active, label="holes"):
        hole = active & (si.bsdf().eval_null_transmission(si, active).x > 0.5)
        ray = si.spawn_ray(ray.d)
        si = dr.select(hole, geometry.scene.ray_intersect(ray, hole), si)
        passed += 1
        active = hole & geometry.is_holed(si) & (passed < MOST_HOLES)
    return si
