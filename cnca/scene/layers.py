"""What cameras see first, as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Layers:
    """First hits; all but the mask belong to the ray through the pixel's centre."""

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
