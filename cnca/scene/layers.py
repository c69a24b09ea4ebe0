"""What cameras see first, as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float


@dataclass(frozen=True)
class Layers:
    """First hits; all but the mask belong to the ray through the pixel's center."""

    mask: Float[np.ndarray, "views height width"]
    """Share of the pixel that the vehicle covers, in [0, 1]."""
    depth: Float[np.ndarray, "views height width"]
    """Distance from the camera along the ray in metres; infinite for the sky."""
    uv: Float[np.ndarray, "views height width 2"]
    """Texture coordinates, v upwards; zero off the vehicle."""
    normal: Float[np.ndarray, "views height width 3"]
    """Unit shading normal in world axes; zero for the sky."""
    albedo: Float[np.ndarray, "views height width 3"]
    """Linear diffuse reflectance with the texture that was rendered last."""


@dataclass(frozen=True)
class Sighting:
    """Another labeled object that a camera sees."""

    label: str
    """The class that it belongs to, such as car or truck."""
    mask: Bool[np.ndarray, "height width"]
    """The pixels whose center shows it, at least one."""
    occluded: float
    """Share of it in the picture that something else hides, in [0, 1)."""

    @property
    def box(self) -> tuple[int, int, int, int]:
        """The pixels that show it, left, top, right and bottom, the last two beyond them."""
        rows, columns = (np.flatnonzero(self.mask.any(axis=axis)) for axis in (1, 0))
        return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1
