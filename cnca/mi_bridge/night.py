"""Light when the sun is below the horizon, in photometric units, and how it is exposed."""

from __future__ import annotations

import math

import numpy as np

from cnca.core.photometry import CANDELAS

TWILIGHT = ((0.0, 2480.0), (-6.0, 3.0), (-12.0, 0.008), (-18.0, 6e-4))
"""Altitude of the sun → lux of scattered sunlight on level ground under a clear sky (twilight in
the AMS Glossary of Meteorology); at 0° what the sky's model has, four times as much as is seen."""
STARLIGHT = 1e-3
"""Lux of a clear night without a moon (RCA Electro-Optics Handbook, 1974)."""


def twilight(altitude: float) -> float:
    """Scattered sunlight as a share of that of a sun at 0°, straight in the logarithm between."""
    angles, lux = np.array(TWILIGHT[::-1]).T
    logarithm = np.log(lux / TWILIGHT[0][1])
    slope = (logarithm[1] - logarithm[0]) / (angles[1] - angles[0])
    beyond = slope * min(altitude - angles[0], 0.0)
    return float(np.exp(np.interp(min(altitude, 0.0), angles, logarithm) + beyond))


def starlight(altitude: float) -> float:
    """Radiance of the starlit sky, even and grey, in W/m²/nm/sr; 0 while the sun is up."""
    return STARLIGHT / math.pi / CANDELAS if altitude < 0 else 0.0


def exposure_at_night(white: float, altitude: float) -> float:
    """Factor in (0, 1] on a metered exposure that leaves night pictures dark; 1 by day.

    Automatic exposure would show starlight as bright as day.  Krawczyk, Myszkowski & Seidel (2005)
    measure the key of pictures, the brightness that a viewer expects, by the luminance Y to which
    the eye is adapted: key = 1.03 − 2 / (2 + log₁₀(Y + 1)).  Here Y is that of white card, and the
    key is counted in that of sunset.

    Args:
        white: radiance of white card in W/m²/nm/sr.
        altitude: of the sun, degrees.
    """
    if altitude >= 0:
        return 1.0
    return min(_key(white * CANDELAS) / _key(TWILIGHT[0][1] / math.pi), 1.0)


def _key(luminance: float) -> float:
    return 1.03 - 2 / (2 + math.log10(luminance + 1))
