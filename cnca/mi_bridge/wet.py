"""Wet ground: darker, smoother, and from half wetness on with puddles.

Water between the grains makes porous ground dark: light that it scatters back is caught in the
film by total reflection and meets the ground again (Ångström 1925; Lekner & Dorf 1988).  With ρ
the dry albedo, R what water reflects of diffuse light from above, p from below,

    ρ_wet = (1 − R) (1 − p) ρ / (1 − p ρ),    p = 1 − (1 − R) / n².

Up to half wetness ρ goes over to that and the film fills the ground's roughness; beyond, puddles
lie where a field of noise over the ground plan is lowest (the stages are those of Lagarde 2013,
the numbers ours).  Neglected: ripples, splashes, and that water hides the ground's bumps.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from jaxtyping import Float

from cnca.mi_bridge.variant import dr, mi

WATER = 1.333
"""Index of refraction n."""
REFLECTED = 0.066
"""R: diffuse light that water reflects from above, the mean of Fresnel's formula."""
CAUGHT = 1 - (1 - REFLECTED) / WATER**2
"""p."""
SPECULAR = ((WATER - 1) / (WATER + 1)) ** 2 / 0.08
"""Of the principled model."""
FILM, PUDDLE = 0.32, 0.06
"""Roughness of wet asphalt and of still water."""
COVER = 0.4
"""Share of the ground under puddles at full wetness."""
TILE, TEXELS = 25.6, 512
"""Metres after which puddles repeat, and texels across."""
EDGE = 0.03
"""Width of a puddle's edge in the field's quantiles."""
LEVEL = 0.8
"""Least vertical part of the normal of what stays wet."""


def wet_albedo(dry: Float[np.ndarray, "*shape 3"], wetness: float) -> Float[np.ndarray, "*shape 3"]:
    """Diffuse reflectance in [0, 1] of ground that is ``wetness`` wet."""
    return dry + min(2 * wetness, 1.0) * (_under_water(dry) - dry)


def _under_water(dry: Any) -> Any:
    """ρ_wet of arrays of NumPy or of Dr.Jit."""
    return (1 - REFLECTED) * (1 - CAUGHT) * dry / (1 - CAUGHT * dry)


class WetColor(mi.Texture):
    """A base color, darkened where water lies: on what looks up."""

    def __init__(self, dry: mi.Texture, wetness: float) -> None:
        super().__init__(mi.Properties())
        self._dry, self._soaked = dry, dr.opaque(mi.Float, min(2 * wetness, 1.0))

    def eval(self, si: mi.SurfaceInteraction3f, active: mi.Bool = True) -> mi.Color3f:
        """Linear reflectance."""
        dry = self._dry.eval(si, active)
        wet = dr.lerp(dry, _under_water(dry), self._soaked)
        return dr.select(dr.abs(si.n.z) > LEVEL, wet, dry)

    def is_spatially_varying(self) -> bool:
        """It is."""
        return True

    def to_string(self) -> str:
        """For Mitsuba's messages."""
        return "WetColor[]"


class WetRoughness(mi.Texture):
    """Roughness of the principled model: dry, under a film of water, or of a puddle."""

    def __init__(self, dry: float, wetness: float) -> None:
        super().__init__(mi.Properties())
        film = dry + min(2 * wetness, 1.0) * (min(FILM, dry) - dry)
        covered = COVER * max(2 * wetness - 1, 0.0)
        self._dry, self._film, self._covered = (
            dr.opaque(mi.Float, value) for value in (dry, film, covered)
        )
        self._puddles = covered > 0

    def eval_1(self, si: mi.SurfaceInteraction3f, active: mi.Bool = True) -> mi.Float:
        """In [0, 1]."""
        wet = mi.Float(self._film)
        if self._puddles:
            height = _heights().eval(mi.Point2f(si.p.x, si.p.y) / TILE, active)[0]
            deep = dr.clip((self._covered - height) / EDGE + 0.5, 0, 1)
            wet = dr.lerp(wet, PUDDLE, deep)
        return dr.select(dr.abs(si.n.z) > LEVEL, wet, self._dry)

    def is_spatially_varying(self) -> bool:
        """It is."""
        return True

    def to_string(self) -> str:
        """For Mitsuba's messages."""
        return "WetRoughness[]"


@cache
def _heights() -> mi.Texture2f:
    """A rolling ground as quantiles in [0, 1], the lowest 0; it repeats without a seam."""
    rng = np.random.default_rng(7)
    shape = (TEXELS, TEXELS)
    frequency = np.hypot(np.fft.fftfreq(TEXELS)[:, None], np.fft.rfftfreq(TEXELS)[None]) * TEXELS
    # Waves of 25 m to 60 cm, longer ones higher.
    rolling = (frequency >= 1) & (frequency <= 40)
    amplitude = np.where(rolling, np.maximum(frequency, 1) ** -1.6, 0.0)
    phase = np.exp(2j * np.pi * rng.random(frequency.shape))
    height = np.fft.irfft2(amplitude * phase, shape)
    quantile = (height.ravel().argsort().argsort() + 0.5) / height.size
    texels = mi.TensorXf(np.float32(quantile.reshape(*shape, 1)))
    return mi.Texture2f(texels, wrap_mode=dr.WrapMode.Repeat)


def wet_principled(
    principled: dict[str, object], wetness: float, *, film: bool = True
) -> dict[str, object]:
    """A principled BSDF, as a dictionary for Mitsuba, with water on what of it looks up.

    Without a ``film`` the water is soaked up, as by grass, and only darkens.
    """
    color = principled["base_color"]
    dry = mi.load_dict(color) if isinstance(color, dict) else color
    wet = principled | {"base_color": WetColor(dry, wetness)}
    if not film:
        return wet
    roughness = float(principled["roughness"])  # type: ignore[arg-type]
    return wet | {
        "roughness": WetRoughness(roughness, wetness),
        "specular": SPECULAR,
    }
