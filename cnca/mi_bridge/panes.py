"""Windows that light passes: thin panes of glass, which bend no ray."""

from __future__ import annotations

from cnca.mi_bridge.variant import dr, mi

MOST_PANES = 8
"""Thin panes of glass that a path may pass; light behind more of them is lost."""


@dr.syntax
def pane_transmittance(scene: mi.Scene, ray: mi.Ray3f, active: mi.Bool) -> mi.Color3f:
    """Share of light that comes along ``ray`` from infinity through panes; 0 behind all else."""
    T = mi.Color3f(1)
    panes = mi.UInt32(0)
    active = mi.Bool(active)
    while dr.hint(active, label="panes"):
        si = scene.ray_intersect(ray, active)
        hit = active & si.is_valid()
        T = dr.select(hit, T * si.bsdf(ray).eval_null_transmission(si, hit), T)
        T = dr.select(hit & (panes == MOST_PANES), 0, T)
        active = hit & (dr.max(T) > 0)
        ray = si.spawn_ray(ray.d)
        panes += 1
    return T
