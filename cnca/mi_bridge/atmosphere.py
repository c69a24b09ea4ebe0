"""Sky and fog of one weather, as the integrator takes them, and how bright they are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cnca.mi_bridge.envmap import PhotographedGround
from cnca.mi_bridge.fog import FogField, solve_fog
from cnca.mi_bridge.fog_layer import FogLayer
from cnca.mi_bridge.forward import ForwardShare
from cnca.mi_bridge.light import lambertian_white, make_light
from cnca.mi_bridge.night import exposure_at_night
from cnca.mi_bridge.sky import Sky
from cnca.mi_bridge.surroundings import Surroundings
from cnca.mi_bridge.variant import mi
from cnca.scene.weather import Weather

DARKEST = 1e-9
"""White in fog over white above it, as starlight to daylight: pictures of darker fog stay black."""


@dataclass(frozen=True, eq=False)
class Atmosphere:
    """What lights a scene, the world in it left out."""

    surroundings: Surroundings
    white: float
    """Radiance of white card at the vehicle, of which exposure is the inverse."""
    sun: Float[np.ndarray, "3"]
    """Irradiance of the direct sun at the vehicle."""
    unit: float
    """Unit of these and all other light here, in W/m²/nm/sr: 1 is white card above the fog."""
    altitude: float
    """Of the sun, degrees."""
    lamps: bool = False
    """Whether a world's lamps are on."""

    def exposed_white(self, white: float) -> float:
        """Radiance that is shown as 1 where white card has ``white``: more at night."""
        return white / exposure_at_night(white * self.unit, self.altitude)


def make_atmosphere(
    weather: Weather,
    ground_albedo: Float[np.ndarray, "3"],
    *,
    sun: str,
    sky: str,
    fog: str,
    panes: bool,
    forward: Callable[[float], ForwardShare] | None,
    ground: mi.Shape | None,
    lamps: bool = False,
) -> Atmosphere:
    """Bake the light of a weather.

    Args:
        sun: "direction" or "disc".
        sky: "map_mis" lets surfaces sample a measured sky by its brightness.
        fog: model of :func:`cnca.mi_bridge.fog.solve_fog`.
        panes: whether some of the vehicle's geometry lets light pass.
        forward: asymmetry of the droplets → share of scattered light that comes from the vehicle.
        lamps: whether a world's are on.
        ground: open ground, which shows the lower half of a measured sky.
    """
    light = make_light(weather, ground_albedo)
    above = lambertian_white(light.sky, light.sun_irradiance, light.sun_direction)
    # From here on white is 1, or float32 would lose the last of dusk and a sun of 10³⁰.
    unit = above if above > 0 else 1.0
    light = light.scaled(1 / unit)
    above_fog = Sky(
        light,
        has_map=weather.sky_scale > 0,
        sun_disc=sun == "disc",
        importance=sky == "map_mis",
    )
    around = Surroundings(above_fog, None, panes)
    if above_fog.measured and ground is not None:
        around.photo = PhotographedGround(above_fog.measured, ground)
        ground_albedo = light.ground_albedo
    layer = weather.fog
    if layer is None or layer.height == 0:
        return Atmosphere(around, 1.0, light.sun_irradiance, unit, weather.sun_altitude, lamps)
    field = solve_fog(layer, light, ground_albedo, fog)
    radiance, direct = _at_height(field, 1.0)
    white = lambertian_white(radiance, direct, light.sun_direction)
    share = forward(layer.asymmetry) if fog == "field" and forward else None
    around.fog = FogLayer(layer, field, above_fog, share)
    return Atmosphere(around, max(white, DARKEST), direct, unit, weather.sun_altitude, lamps)


def _at_height(
    field: FogField, height: float
) -> tuple[Float[np.ndarray, "rows columns 3"], Float[np.ndarray, "3"]]:
    """Diffuse radiance and direct sun at a height in the layer."""
    level = int(np.searchsorted(field.heights, height).clip(0, len(field.heights) - 1))
    return field.radiance[level], field.sun[level]
