"""Sun, sky and fog of one moment."""

from __future__ import annotations

from dataclasses import dataclass, replace

KOSCHMIEDER = 3.912
"""−ln 0.02: visibility is the distance at which contrast falls to 2 % (Koschmieder 1924)."""

MOST_ASYMMETRY = 0.9999
"""Largest |g|: a lobe of 0.01°, far below the sun's disc; float32 cannot tell 1 − g from 0 at 1."""


@dataclass(frozen=True)
class Fog:
    """A horizontal layer of droplets from the ground up to ``height``."""

    visibility: float
    """Meteorological visibility in metres, > 0."""
    height: float = 100.0
    """Top of the layer above the ground in metres, ≥ 0."""
    albedo: float = 0.99
    """Single-scattering albedo of the droplets in [0, 1]."""
    asymmetry: float = 0.85
    """Mean cosine g of Henyey–Greenstein scattering, |g| ≤ :data:`MOST_ASYMMETRY`."""

    @property
    def extinction(self) -> float:
        """σ_t in 1/m, grey."""
        return KOSCHMIEDER / self.visibility


@dataclass(frozen=True)
class SkyMap:
    """A measured environment in place of the model of a clear sky."""

    file: str
    """A latitude–longitude picture, ``.hdr`` or ``.exr``."""
    rotation: float = 0.0
    """Degrees counter-clockwise; at 0 its middle looks along +x, the vehicle's front."""
    height: float = 1.6
    """Metres above the ground from which it was taken, > 0."""
    radius: float = 20.0
    """Metres from there to what stands around the open ground, > 0; cameras see it so far away."""
    missing: str | None = None
    """What to tell a user who does not have the file."""


@dataclass(frozen=True)
class Weather:
    """What lights the scene; angles in degrees."""

    sun_altitude: float = 45.0
    """Angle of the sun above the horizon in [−90, 90]."""
    sun_azimuth: float = 120.0
    """Direction of the sun counter-clockwise from +x (the vehicle's front) seen from above."""
    turbidity: float = 3.0
    """Haziness of the sky in [1, 10] (Hosek–Wilkie)."""
    sun_scale: float = 1.0
    """Factor on the sun's radiance, ≥ 0; 0 is an overcast sky without sun."""
    sky_scale: float = 1.0
    """Factor on the sky's radiance, ≥ 0."""
    fog: Fog | None = None
    sky_map: SkyMap | None = None
    """If there is one, the sun stands where the map has it, and the turbidity means nothing."""

    lamps: str = "auto"
    """Whether a world's lamps are ``on`` or ``off``; ``auto`` is on when the sun is down."""

    @property
    def lamps_lit(self) -> bool:
        """Whether lamps are on; the sun of a measured sky without one may be anywhere."""
        down = self.sun_altitude < 0 and self.sky_map is None
        return self.lamps == "on" or (self.lamps == "auto" and down)

    def turned(self, altitude: float, azimuth: float) -> Weather:
        """The weather with its sun elsewhere.

        The light of a map turns with its sun, which keeps its altitude.
        """
        if self.sky_map is None:
            return replace(self, sun_altitude=altitude, sun_azimuth=azimuth)
        rotation = self.sky_map.rotation + azimuth - self.sun_azimuth
        return replace(self, sun_azimuth=azimuth, sky_map=replace(self.sky_map, rotation=rotation))
