"""Multiple scattering of light in a fog layer, solved once per weather.

Away from the vehicle the layer is horizontally uniform, so its radiance depends on height and
direction alone and obeys the plane-parallel transfer equation (Chandrasekhar 1960, chapter I)

    μ dI/dτ = −I + J,    J(τ, ω) = ϖ ∫ p(ω·ω') I(τ, ω') dω' + ϖ p(ω·ω_s) E_s exp(−τ_above/μ_s).

I is the diffuse radiance (the sky that came through included), J the source function, ϖ the
droplets' albedo, p the phase function, E_s the sun's irradiance above the layer.  A ray of length
ℓ through the fog then gathers ∫ σ_t exp(−σ_t s) J ds: fog costs a table look-up, not a random walk.

Two simpler models say what that is worth: ``single`` takes only light that was scattered once, and
``airlight`` (Koschmieder 1924) one J everywhere, the mean of all light that reaches the layer.

Neglected: the vehicle, both the shadow that it casts into the fog and the light that it takes from
its surroundings.  Its own light, scattered forwards, is :mod:`cnca.mi_bridge.forward`'s.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float

from cnca.core.errors import NonFiniteError
from cnca.mi_bridge.light import Light
from cnca.scene.environment import sky_directions, sky_solid_angles
from cnca.scene.weather import Fog

ROWS, COLUMNS, LEVELS = 24, 32, 24


@dataclass(frozen=True)
class FogPlaces:
    """How a world's fog differs from place to place, relative to that at its origin."""

    reach: float
    """Metres from the origin to the outermost nodes, along x and y."""
    factors: Float[np.ndarray, "levels rows columns 4"]
    """a₀ and a at nodes along y (rows) and x: light from direction ω is max(a₀ + a · ω, 0) times
    that at the origin."""


@dataclass(frozen=True)
class FogField:
    """The layer's light on a grid of heights and latitude–longitude directions of travel.

    Rows and columns are those of :func:`cnca.mi_bridge.light.sky_directions`; an entry at direction
    d holds the light that arrives *from* d, as an eye that looks along d sees it.
    """

    heights: Float[np.ndarray, " levels"]
    """Metres above the ground, from 0 to the top of the layer: :func:`level_heights`."""
    stretch: float
    """How much denser the levels lie at both ends of the layer."""
    radiance: Float[np.ndarray, "levels rows columns 3"]
    """I: diffuse radiance, sky light included, direct sun excluded."""
    source: Float[np.ndarray, "levels rows columns 3"]
    """J without the first scattering of the sun, which the integrator knows in closed form."""
    sun: Float[np.ndarray, "levels 3"]
    """Irradiance of the direct sun that is left at each height."""
    airlight: Float[np.ndarray, "3"] | None = None
    """The one J of the model ``airlight``, in which the sun has its part."""
    places: FogPlaces | None = None
    """In a world; over open ground all places are alike."""


def level_heights(
    height: float, stretch: float, levels: int = LEVELS
) -> Float[np.ndarray, " levels"]:
    """Heights of the levels: H/2 (1 + tanh(a t) / tanh(a)) for even steps of t in [−1, 1].

    Light changes fastest within an optical depth of the layer's two ends, however thick it is.
    """
    t = np.linspace(-1, 1, levels)
    return height / 2 * (1 + np.tanh(stretch * t) / np.tanh(stretch))


def henyey_greenstein(
    cosine: Float[np.ndarray, "*shape"], asymmetry: float
) -> Float[np.ndarray, "*shape"]:
    """Phase function in 1/sr (Henyey & Greenstein 1941) of the cosine between travel directions."""
    g = asymmetry
    return (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * cosine) ** 1.5)


def solve_fog(
    fog: Fog, light: Light, ground_albedo: Float[np.ndarray, "3"], model: str = "field"
) -> FogField:
    """Solve the transfer equation with discrete ordinates.

    Args:
        model: ``field``, or what stands for its solution: ``single`` or ``airlight``.

    Raises:
        NonFiniteError: the solution is not finite.
    """
    stretch = 1 + 0.5 * np.log(max(fog.extinction * fog.height, 1.0))
    heights = level_heights(fog.height, stretch)
    directions = sky_directions(ROWS, COLUMNS).reshape(-1, 3)
    weights = np.repeat(sky_solid_angles(ROWS, COLUMNS)[:, 0], COLUMNS)
    scattering = fog.albedo * _phase_matrix(directions, weights, fog.asymmetry)
    # Below the horizon there is no sun, and the slant path must not divide by zero.
    mu_sun = max(float(light.sun_direction[2]), 1e-4)
    slant = np.exp(-fog.extinction * (fog.height - heights) / mu_sun)
    sun = slant[:, None] * light.sun_irradiance
    single = henyey_greenstein(directions @ light.sun_direction, fog.asymmetry)
    single = fog.albedo * single / max(float(single @ weights), 1e-12)

    layer = _Layer(fog.extinction, heights, directions, weights, ground_albedo)
    sky = _downsample(light.sky).reshape(-1, 3)
    ground_sun = ground_albedo / np.pi * sun[0] * max(float(light.sun_direction[2]), 0.0)
    sunlight = layer.first_scattering(single[None, :, None] * sun[:, None, :], mu_sun)
    shape = (LEVELS, len(directions), 3)

    def scatter(radiance: np.ndarray) -> np.ndarray:
        return np.einsum("de,lec->ldc", scattering, radiance, optimize=True)

    airlight = None
    if model == "airlight":
        airlight = fog.albedo * _mean_light(light)
        source = np.broadcast_to(airlight, shape)
        radiance = layer.radiance(source, None, sky, ground_sun)
    elif model == "single":
        source = scatter(layer.radiance(np.zeros(shape), None, sky, ground_sun))
        radiance = layer.radiance(source, sunlight, sky, ground_sun)
    else:
        # Source = scattering of what comes from outside + of what the source itself emits.
        incoming = layer.radiance(np.zeros(shape), sunlight, sky, ground_sun)
        meridian = partial(
            _Layer, fog.extinction, heights, directions[::COLUMNS], weights[::COLUMNS]
        )
        source = _scattered_again(scatter(incoming), scattering, meridian, ground_albedo)
        radiance = incoming + layer.radiance(source)
    if not (np.isfinite(source).all() and np.isfinite(radiance).all()):
        raise NonFiniteError(f"fog field has no finite solution for {fog}")
    grid = (LEVELS, ROWS, COLUMNS, 3)
    return FogField(heights, stretch, radiance.reshape(grid), source.reshape(grid), sun, airlight)


class _Layer:
    """Straight rays between the levels of the layer, for sources that are known on the levels."""

    def __init__(
        self,
        extinction: float,
        heights: Float[np.ndarray, " levels"],
        directions: Float[np.ndarray, "n 3"],
        weights: Float[np.ndarray, " n"],
        ground_albedo: float | Float[np.ndarray, "3"],
    ) -> None:
        self.mu = np.abs(directions[:, 2])
        self.looks_up = directions[:, 2] > 0  # and sees light that travels down
        self.tau = extinction * np.diff(heights)[:, None]
        steps = self.tau / self.mu
        self.transmitted = np.exp(-steps)
        # Mean transmittance of a step; 1 where there is no fog.
        average = np.where(steps < 1e-12, 1.0, -np.expm1(-steps) / np.maximum(steps, 1e-12))
        # Weights of a source, linear in τ, at the far and at the near end of a step.
        self.far, self.near = average - self.transmitted, 1 - average
        # ∫ cos dω is π on the grid too, or white ground gains energy and thick fog amplifies it.
        cosine = np.where(self.looks_up, self.mu, 0.0) * weights
        self.to_irradiance = np.pi * cosine / cosine.sum()
        self.ground_albedo = ground_albedo

    def first_scattering(
        self, source: Float[np.ndarray, "levels n 3"], mu_sun: float
    ) -> Float[np.ndarray, "steps n 3"]:
        """What each step adds where the source falls like the direct sun, exp(−τ/``mu_sun``).

        Exact: thick fog takes the sun away within a small part of one step.
        """
        slant, steps = self.tau / mu_sun, self.tau / self.mu
        nearly = np.abs(steps - slant) < 1e-4  # 0/0: take the limit
        ratio = steps / np.where(nearly, 1.0, steps - slant)
        up = np.where(
            nearly,
            steps * np.exp(-(steps + slant) / 2),
            ratio * (np.exp(-slant) - self.transmitted),
        )
        down = -np.expm1(-(steps + slant)) / (1 + self.mu / mu_sun)
        return np.where(self.looks_up, up, down)[..., None] * source[1:]

    def radiance(
        self,
        source: Float[np.ndarray, "levels n channels"],
        added: Float[np.ndarray, "steps n channels"] | None = None,
        sky: Float[np.ndarray, "n channels"] | None = None,
        ground_sun: Float[np.ndarray, "3"] | float = 0.0,
    ) -> Float[np.ndarray, "levels n channels"]:
        """Radiance at all levels; ``added`` is what each step gains besides ``source``."""
        radiance = np.zeros_like(source)
        added = np.zeros_like(source[1:]) if added is None else added
        up, down = self.looks_up, ~self.looks_up
        if sky is not None:
            radiance[-1, up] = sky[up]
        for k in range(len(source) - 2, -1, -1):
            self._step(radiance, source, added[k], up, k, k + 1, k)
        irradiance = self.to_irradiance @ radiance[0]
        radiance[0, down] = self.ground_albedo / np.pi * irradiance + ground_sun
        for k in range(len(source) - 1):
            self._step(radiance, source, added[k], down, k, k, k + 1)
        return radiance

    def _step(
        self,
        radiance: np.ndarray,
        source: np.ndarray,
        added: np.ndarray,
        which: np.ndarray,
        step: int,
        far: int,
        near: int,
    ) -> None:
        """Follow the light of the directions ``which`` from level ``far`` to level ``near``."""
        a, f, n = (w[step, which, None] for w in (self.transmitted, self.far, self.near))
        radiance[near, which] = (
            a * radiance[far, which]
            + f * source[far, which]
            + n * source[near, which]
            + added[which]
        )


def _scattered_again(
    first: Float[np.ndarray, "levels n 3"],
    scattering: Float[np.ndarray, "n n"],
    meridian: Callable[[float], _Layer],
    ground_albedo: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "levels n 3"]:
    """Solve J = first + S R J; R are the rays inside the layer, S is the scattering.

    Neither knows an azimuth, so each Fourier mode of the azimuth is a small system of its own
    (Chandrasekhar 1960, section 48); only the mean over azimuths meets the ground.
    """
    size = LEVELS * ROWS
    unit = np.eye(size).reshape(LEVELS, ROWS, size)
    phase = np.fft.rfft(scattering.reshape(ROWS, COLUMNS, ROWS, COLUMNS)[:, 0]).real
    modes = np.fft.rfft(first.reshape(LEVELS, ROWS, COLUMNS, 3), axis=2)

    def solve(mode: int, rays: np.ndarray, right: np.ndarray) -> np.ndarray:
        matrix = np.eye(size) - (phase[..., mode] @ rays).reshape(size, size)
        return np.linalg.solve(matrix, right.reshape(size, -1)).reshape(right.shape)

    for color, albedo in enumerate(ground_albedo):
        modes[:, :, 0, color] = solve(0, meridian(albedo).radiance(unit), modes[:, :, 0, color])
    rays = meridian(0.0).radiance(unit)
    for mode in range(1, modes.shape[2]):
        modes[:, :, mode] = solve(mode, rays, modes[:, :, mode])
    return np.fft.irfft(modes, COLUMNS, axis=2).reshape(first.shape)


def _phase_matrix(
    directions: Float[np.ndarray, "n 3"], weights: Float[np.ndarray, " n"], asymmetry: float
) -> Float[np.ndarray, "n n"]:
    """Weighted phase function, scaled so that scattering on the grid loses and gains no energy."""
    phase = henyey_greenstein((directions @ directions.T).clip(-1, 1), asymmetry)
    scale = np.ones(len(weights))
    for _ in range(50):  # symmetric Sinkhorn scaling: rows and columns both integrate to one
        scale /= np.sqrt(scale * (phase @ (scale * weights)))
    return scale[:, None] * phase * (scale * weights)[None, :]


def _mean_light(light: Light) -> Float[np.ndarray, "3"]:
    """Mean radiance over all directions of what reaches the layer, the sun's included."""
    solid_angles = sky_solid_angles(*light.sky.shape[:2])[..., None]
    return ((light.sky * solid_angles).sum(axis=(0, 1)) + light.sun_irradiance) / (4 * np.pi)


def _downsample(sky: Float[np.ndarray, "r c 3"]) -> Float[np.ndarray, "rows columns 3"]:
    """Mean radiance per solver direction, weighted by solid angle; the horizon stays sharp."""
    rows, columns = sky.shape[:2]
    fine = sky_solid_angles(rows, columns)[..., None]
    row_of = ((np.arange(rows) + 0.5) * ROWS / rows).astype(int)
    column_of = ((np.arange(columns) + 0.5) * COLUMNS / columns).astype(int)
    total = np.zeros((ROWS, COLUMNS, 3))
    norm = np.zeros((ROWS, COLUMNS, 1))
    index = np.ix_(row_of, column_of)
    np.add.at(total, index, sky * fine)
    np.add.at(norm, index, np.broadcast_to(fine, (rows, columns, 1)))
    return total / norm
