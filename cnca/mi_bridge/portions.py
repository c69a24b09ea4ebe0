"""Which part of a picture in a world is rendered: all of it, or the vehicle alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cnca.effects.world import GEOMETRY


@dataclass(frozen=True)
class Portion:
    """Which part of a picture is rendered, and how."""

    vehicle_only: bool = False
    """As :class:`cnca.mi_bridge.bridge.Shot` takes it."""
    rung: str = GEOMETRY
    """How much of a world takes part; for the vehicle alone a demand may say otherwise."""
    shares: Float[np.ndarray, " pixels"] | None = None
    """As :class:`cnca.mi_bridge.bridge.Shot` takes them; unused where the geometry is traced."""


WHOLE = Portion()


def vehicle_part(shares: Float[np.ndarray, " pixels"]) -> Portion:
    """The vehicle in the world's kept light; ``shares`` is how much of it nothing hides."""
    return Portion(True, "probe", shares)
