"""The painted triangles of a vehicle, all parts together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from cnca.core.errors import MeshError
from cnca.vehicle.mesh.surface import face_crosses
from cnca.vehicle.model import Vehicle


@dataclass(frozen=True)
class Skin:
    """The triangles of all painted parts of a vehicle."""

    vertices: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]
    uvs: Float[np.ndarray, "vertices 2"]

    @classmethod
    def of(cls, vehicle: Vehicle) -> Skin:
        """Join the painted parts; vertices without texture coordinates get zeros.

        Raises MeshError where nothing is painted.
        """
        parts = [part for part in vehicle.parts if part.material == "paint"]
        if not parts:
            raise MeshError(f"{vehicle.name}: nothing to lay out, since no part is paint")
        starts = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
        uvs = [np.zeros((len(p.vertices), 2)) if p.uvs is None else p.uvs for p in parts]
        return cls(
            np.concatenate([part.vertices for part in parts]),
            np.concatenate([p.faces + start for p, start in zip(parts, starts, strict=True)]),
            np.concatenate(uvs),
        )

    @property
    def corners(self) -> Float[np.ndarray, "faces 3 2"]:
        """Texture coordinates of each face."""
        return self.uvs[self.faces]

    @property
    def metres_per_unit(self) -> float:
        """Length on the car of a texture's side, on average."""
        area = np.linalg.norm(face_crosses(self.vertices, self.faces), axis=1).sum()
        flat = np.abs(np.linalg.det(self.corners[:, 1:] - self.corners[:, :1])).sum()
        return float((area / max(flat, 1e-12)) ** 0.5)
