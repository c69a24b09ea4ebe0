"""A vehicle as arrays: what every renderer and tool understands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from cnca.scene.materials import MATERIALS, Material


@dataclass(frozen=True)
class Part:
    """One piece of a vehicle, of one material; metres, +x front, +y left, +z up, ground at 0."""

    name: str
    material: str
    """A key of ``cnca.scene.materials.MATERIALS``, such as paint or glass."""
    vertices: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]
    """Counter-clockwise seen from outside."""
    normals: Float[np.ndarray, "vertices 3"]
    """Unit shading normals pointing outwards."""
    uvs: Float[np.ndarray, "vertices 2"] | None
    """Texture coordinates in [0, 1], v upwards; needed by the painted part alone."""


@dataclass(frozen=True)
class Vehicle:
    """All parts; exactly those with material ``paint`` carry the texture."""

    name: str
    parts: tuple[Part, ...]
    paint: Material = MATERIALS["paint"]
    """How the paint reflects light; its color is the texture's."""
    glass: Material = MATERIALS["glass"]
    """What the windows are made of."""

    def material(self, name: str) -> Material:
        """What a part of the material ``name`` is made of."""
        return {"paint": self.paint, "glass": self.glass}.get(name) or MATERIALS[name]
