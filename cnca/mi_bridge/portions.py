"""Parts of a picture in a world: what is the vehicle, and what is the rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cnca.effects.world import GEOMETRY


@dataclass(frozen=True)
class Portion:
    """Which part of a picture is rendered, and how."""

    only: str | None = None
    """As :class:`cnca.mi_bridge.bridge.Shot` takes it."""
    rung: str = GEOMETRY
    """How much of a world takes part, unless a demand says."""
    shares: Float[np.ndarray, " pixels"] | None = None
    """As :class:`cnca.mi_bridge.bridge.Shot` takes them."""


WHOLE = Portion()
REST = Portion("rest")
"""All but the vehicle."""


def vehicle_part(shares: Float[np.ndarray, " pixels"]) -> Portion:
    """The vehicle in the world's kept light; ``shares`` is what of it nothing hides."""
    return Portion("vehicle", "probe", shares)
