"""Multiply scattered light in a fog layer, solved once per weather.

Away from the vehicle the layer is horizontally uniform, so its radiance depends on height and
direction alone and obeys the plane-parallel transfer equation (Chandrasekhar 1960, chapter I)

    μ dI/dτ = −I + J,    J(τ, ω) = ϖ ∫ p(ω·ω') I(τ, ω') dω' + ϖ p(ω·ω_s) E_s exp(−τ_above/μ_s).

I is the diffuse radiance (the sky that came through included), J the source function, ϖ the
droplets' albedo, p the phase function, E_s the sun's irradiance above the layer.  A ray of length
ℓ through the fog then gathers ∫ σ_t exp(−σ_t s) J ds: fog costs a table look-up, not a random walk.

Neglected, and to be measured against a full simulation: the shadow that the vehicle casts into
the fog, and light that travels from paint to droplets and back.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.sparse.linalg import LinearOperator, gmres

from cnca.errors import NonFiniteError
from cnca.mi_bridge.light import Light, sky_directions, sky_solid_angles
from cnca.scene.weather import Fog

ROWS, COLUMNS, LEVELS = 24, 32, 24
TOLERANCE = 1e-4
"""Relative residual at which the transfer equation counts as solved."""


@dataclass(frozen=True)
class FogField:
    """The layer's light on a grid of heights and latitude–longitude directions of travel.

    Rows and columns are those of :func:`cnca.mi_bridge.light.sky_directions`; an entry at direction
    d holds the light that arrives *from* d, as an eye that looks along d sees it.
    """

    heights: Float[np.ndarray, " levels"]
    """Metres above the ground, from 0 to the top of the layer, denser at both ends."""
    radiance: Float[np.ndarray, "levels rows columns 3"]
    """I: diffuse radiance, sky light included, direct sun excluded."""
    source: Float[np.ndarray, "levels rows columns 3"]
    """J without the first scattering of the sun, which the integrator knows in closed form."""
    sun: Float[np.ndarray, "levels 3"]
    """Irradiance of the direct sun that is left at each height."""


def henyey_greenstein(
    cosine: Float[np.ndarray, "*shape"], asymmetry: float
) -> Float[np.ndarray, "*shape"]:
    """Phase function in 1/sr (Henyey & Greenstein 1941); ``cosine`` is between the travel directions."""
    g = asymmetry
    return (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * cosine) ** 1.5)


def solve_fog(fog: Fog, light: Light, ground_albedo: Float[np.ndarray, "3"]) -> FogField:
    """Solve the transfer equation with discrete ordinates and GMRES.

    Raises:
        NonFiniteError: the solution is not finite.
    """
    heights = fog.height * (1 - np.cos(np.linspace(0, np.pi, LEVELS))) / 2
    directions = sky_directions(ROWS, COLUMNS).reshape(-1, 3)
    weights = np.repeat(sky_solid_angles(ROWS, COLUMNS)[:, 0], COLUMNS)
    scattering = fog.albedo * _phase_matrix(directions, weights, fog.asymmetry)
    # Looking up (row 0) one sees light that travels down.
    looks_up = directions[:, 2] > 0
    steps = fog.extinction * np.diff(heights)[:, None] / np.abs(directions[:, 2])
    attenuation = np.exp(-steps)
    average = -np.expm1(-steps) / np.maximum(steps, 1e-12)  # mean transmittance, 1 for no fog
    average = np.where(steps < 1e-12, 1.0, average)

    # Unscattered sun; below the horizon there is none and the slant path must not divide by zero.
    mu_sun = max(float(light.sun_direction[2]), 1e-4)
    slant = np.exp(-fog.extinction * (fog.height - heights) / mu_sun)
    sun = slant[:, None] * light.sun_irradiance
    single = henyey_greenstein(directions @ light.sun_direction, fog.asymmetry)
    single = fog.albedo * single / max(float(single @ weights), 1e-12)
    source_sun = single[None, :, None] * sun[:, None, :]

    sky = _downsample(light.sky).reshape(-1, 3)
    cosine_down = np.where(looks_up, directions[:, 2], 0.0) * weights
    ground_sun = ground_albedo / np.pi * sun[0] * max(float(light.sun_direction[2]), 0.0)

    def transport(source: np.ndarray, sky: np.ndarray, ground_sun: np.ndarray) -> np.ndarray:
        """Radiance at all levels for a source that is linear in τ between them."""
        radiance = np.empty_like(source)
        radiance[-1, looks_up] = sky[looks_up]
        far, near = average - attenuation, 1 - average
        for k in range(LEVELS - 2, -1, -1):
            a, f, n = (w[k, looks_up, None] for w in (attenuation, far, near))
            above, here = source[k + 1, looks_up], source[k, looks_up]
            radiance[k, looks_up] = a * radiance[k + 1, looks_up] + f * above + n * here
        irradiance = cosine_down[looks_up] @ radiance[0, looks_up]
        radiance[0, ~looks_up] = ground_albedo / np.pi * irradiance + ground_sun
        for k in range(LEVELS - 1):
            a, f, n = (w[k, ~looks_up, None] for w in (attenuation, far, near))
            below, here = source[k, ~looks_up], source[k + 1, ~looks_up]
            radiance[k + 1, ~looks_up] = a * radiance[k, ~looks_up] + f * below + n * here
        return radiance

    shape = (LEVELS, len(directions), 3)

    def scatter(radiance: np.ndarray) -> np.ndarray:
        return np.einsum("de,lec->ldc", scattering, radiance, optimize=True)

    def residual(source: np.ndarray) -> np.ndarray:
        dark_sky, dark_ground = np.zeros_like(sky), np.zeros(3)
        source = source.reshape(shape)
        return (source - scatter(transport(source, dark_sky, dark_ground))).ravel()

    # Source = first scattering of sky and ground light + scattering of what the source itself emits.
    first = scatter(transport(source_sun, sky, ground_sun))
    operator = LinearOperator((first.size, first.size), matvec=residual)
    solution, _ = gmres(operator, first.ravel(), rtol=TOLERANCE, restart=40, maxiter=10)
    source = solution.reshape(shape)
    radiance = transport(source + source_sun, sky, ground_sun)
    if not (np.isfinite(source).all() and np.isfinite(radiance).all()):
        raise NonFiniteError(f"fog field is not finite for {fog}")
    grid = (LEVELS, ROWS, COLUMNS, 3)
    return FogField(heights, radiance.reshape(grid), source.reshape(grid), sun)


def _phase_matrix(
    directions: Float[np.ndarray, "n 3"], weights: Float[np.ndarray, " n"], asymmetry: float
) -> Float[np.ndarray, "n n"]:
    """Weighted phase function, scaled so that scattering on the grid loses and gains no energy."""
    phase = henyey_greenstein((directions @ directions.T).clip(-1, 1), asymmetry)
    scale = np.ones(len(weights))
    for _ in range(50):  # symmetric Sinkhorn scaling: rows and columns both integrate to one
        scale /= np.sqrt(scale * (phase @ (scale * weights)))
    return scale[:, None] * phase * (scale * weights)[None, :]


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
