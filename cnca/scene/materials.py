"""How the parts of a vehicle reflect light: parameters of the Disney principled model.

Source: B. Burley, "Physically Based Shading at Disney", SIGGRAPH 2012 course notes, section 5.
Base colors are *linear* reflectances and stay inside the range of real car materials.
"""

from __future__ import annotations

from dataclasses import dataclass

LinearRgb = tuple[float, float, float]


@dataclass(frozen=True)
class Material:
    """A principled surface; every value lies in [0, 1]."""

    base_color: LinearRgb
    """Linear reflectance; for ``paint`` only the color before a texture is given."""
    roughness: float
    """0 a mirror, 1 chalk; the microfacet width is its square, but at least 0.001."""
    specular: float = 0.5
    """Reflection at normal incidence as a fraction of 8 %: 0.5 is a refractive index of 1.5."""
    clearcoat: float = 0.0
    """Strength of a second, colorless lacquer layer."""
    clearcoat_gloss: float = 0.0
    """0 satin lacquer, 1 mirror-like lacquer."""
    metallic: float = 0.0
    """0 a dielectric, 1 a metal."""
    transmission: float = 0.0
    """Share of light that passes the inside of a thin pane; 0 is opaque."""


MATERIALS: dict[str, Material] = {
    "paint": Material((0.60, 0.60, 0.60), 0.35, clearcoat=1.0, clearcoat_gloss=0.95),
    "glass": Material((0.006, 0.007, 0.007), 0.04, specular=0.6),
    "tyre": Material((0.020, 0.020, 0.021), 0.85, specular=0.3),
    "metal": Material((0.62, 0.63, 0.65), 0.28, metallic=1.0),
    "light": Material((0.50, 0.52, 0.55), 0.18, clearcoat=1.0, clearcoat_gloss=1.0, metallic=0.8),
    "tail_light": Material((0.42, 0.012, 0.010), 0.12, clearcoat=1.0, clearcoat_gloss=1.0),
    "plate": Material((0.72, 0.72, 0.70), 0.50),
    "trim": Material((0.018, 0.018, 0.019), 0.55, specular=0.4),
    "underbody": Material((0.012, 0.012, 0.012), 0.90, specular=0.2),
}
"""Every material that a :class:`cnca.vehicle.model.Part` may name."""
