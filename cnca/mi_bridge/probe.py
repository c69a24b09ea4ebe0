"""The world's light at the vehicle, kept: what its geometry would reflect and keep off.

A panorama holds the radiance that arrives at the vehicle's middle from every direction, the sky's
where nothing stands before it; the fog up to there is in it.  A map of the sun says how much of the
direct sun passes the world on its way to each point of the vehicle and of the ground around it.

Neglected: that the world looks a little different from the vehicle's ends than from its middle, and
the light that the texture throws on the world beyond the near ground, which is traced.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cnca.mi_bridge.latlong import direction_uv, wrap_columns
from cnca.mi_bridge.variant import dr, mi

Corners = tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]


@dataclass(frozen=True)
class Kept:
    """What a probe is made of."""

    radiance: Float[np.ndarray, "rows columns 3"]
    """Of directions as :func:`cnca.mi_bridge.light.sky_directions` has them, in the sky's units."""
    sun_shares: Float[np.ndarray, "size size 2"]
    """Share of the sun's light in [0, 1] on a square across its rays: for the vehicle's box, and
    for the ground around it."""
    box: Corners
    """Lowest and highest corner of the vehicle in metres."""
    half_width: float
    """Half a side of the square in metres; its middle is the box's."""
    frame: Float[np.ndarray, "3 3"]
    """Unit vectors along the square's columns, its rows, and towards the sun."""

    @property
    def middle(self) -> Float[np.ndarray, "3"]:
        """Of the vehicle's box."""
        return (self.box[0] + self.box[1]) / 2


class Probe:
    """A :class:`Kept` as textures that kernels read."""

    def __init__(self, kept: Kept) -> None:
        self.kept = kept
        self._columns = kept.radiance.shape[1]
        self._map = mi.Texture2f(wrap_columns(kept.radiance), wrap_mode=dr.WrapMode.Clamp)
        shares = mi.TensorXf(np.ascontiguousarray(kept.sun_shares, dtype=np.float32))
        self._shares = mi.Texture2f(shares, wrap_mode=dr.WrapMode.Clamp)
        low, high = kept.box
        self._numbers = [
            mi.Vector3f(*vector.tolist())
            for vector in (kept.middle, low - SKIN, high + SKIN, *kept.frame[:2] / kept.half_width)
        ]
        dr.make_opaque(self._numbers)  # other places need no other kernel

    def radiance(self, d: mi.Vector3f, active: mi.Bool) -> mi.Color3f:
        """Radiance that arrives from direction ``d``, without the sun's disc."""
        return mi.Color3f(self._map.eval(direction_uv(d, self._columns), active))

    def sun_share(self, p: mi.Point3f, active: mi.Bool) -> mi.Float:
        """Share of the direct sun that the world lets through to a point."""
        middle, low, high, across, along = self._numbers
        away = p - middle
        uv = 0.5 + 0.5 * mi.Point2f(dr.dot(away, across), dr.dot(away, along))
        vehicle, ground = self._shares.eval(uv, active)
        return dr.select(dr.all((p > low) & (p < high)), vehicle, ground)


SKIN = 0.02
"""Metres around the vehicle's box that still count as its own."""
