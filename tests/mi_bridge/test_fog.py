"""The plane-parallel fog field against closed forms and conservation laws."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from cnca.mi_bridge.fog import (
    COLUMNS,
    LEVELS,
    ROWS,
    FogField,
    henyey_greenstein,
    level_heights,
    solve_fog,
)
from cnca.mi_bridge.light import Light, make_light, sky_directions, sky_solid_angles
from cnca.scene.weather import Fog, Weather
from tests.mi_bridge.conftest import uniform_light

GROUND = np.full(3, 0.2)
DIRECTIONS = sky_directions(ROWS, COLUMNS)
SOLID_ANGLES = sky_solid_angles(ROWS, COLUMNS)


def net_flux(field: FogField, light: Light) -> np.ndarray:
    """Downward minus upward irradiance at each level, mean of the colors."""
    cosine = (DIRECTIONS[..., 2] * SOLID_ANGLES)[None, ..., None]
    diffuse = (field.radiance * cosine).sum(axis=(1, 2))
    return (diffuse + field.sun * max(light.sun_direction[2], 0)).mean(axis=1)


def incoming(light: Light) -> float:
    """Downward irradiance above the layer."""
    rows, columns = light.sky.shape[:2]
    cosine = sky_directions(rows, columns)[..., 2].clip(min=0) * sky_solid_angles(rows, columns)
    sky = (light.sky * cosine[..., None]).sum(axis=(0, 1))
    return float((sky + light.sun_irradiance * max(light.sun_direction[2], 0)).mean())


@pytest.mark.parametrize("altitude", [40, 5, -5])
@pytest.mark.parametrize(
    ("visibility", "bound"), [(1e9, 1e-6), (300, 0.002), (60, 0.01), (10, 0.04)]
)
def test_droplets_that_absorb_nothing_keep_the_flux(altitude, visibility, bound):
    light = make_light(Weather(sun_altitude=altitude), GROUND)
    field = solve_fog(Fog(visibility, height=60, albedo=1.0), light, GROUND)
    assert np.ptp(net_flux(field, light)) < bound * incoming(light)


def test_droplets_that_absorb_take_flux_away():
    light = make_light(Weather(sun_altitude=40), GROUND)
    flux = net_flux(solve_fog(Fog(60, height=60, albedo=0.9), light, GROUND), light)
    assert (np.diff(flux) > 0).all()


def test_droplets_that_only_absorb_obey_beer_and_lambert():
    light = make_light(Weather(sun_altitude=30), GROUND)
    fog = Fog(visibility=100, height=50, albedo=0.0)
    field = solve_fog(fog, light, GROUND)
    above = fog.height - field.heights
    expected = np.exp(-fog.extinction * above / np.sin(np.radians(30)))
    np.testing.assert_allclose(field.sun / light.sun_irradiance, np.tile(expected, (3, 1)).T)
    up = DIRECTIONS[: ROWS // 2, :, 2]
    sky = field.radiance[-1, : ROWS // 2]
    attenuated = np.exp(-fog.extinction * fog.height / up)[..., None] * sky
    np.testing.assert_allclose(field.radiance[0, : ROWS // 2], attenuated, rtol=1e-9)
    assert (field.source == 0).all()


def test_thin_fog_becomes_the_clear_sky():
    light = make_light(Weather(), GROUND)
    field = solve_fog(Fog(visibility=1e9), light, GROUND)
    np.testing.assert_allclose(field.radiance[0], field.radiance[-1], rtol=1e-4)
    np.testing.assert_allclose(field.sun, np.tile(light.sun_irradiance, (LEVELS, 1)), rtol=1e-5)
    # The solver's coarser grid holds the same light as the sky's map.
    coarse = (field.radiance[0] * SOLID_ANGLES[..., None]).sum(axis=(0, 1))[None]
    fine = (light.sky * sky_solid_angles(128, 256)[..., None]).sum(axis=(0, 1))[None]
    np.testing.assert_allclose(coarse, fine, rtol=5e-3)


@pytest.mark.parametrize(
    ("visibility", "asymmetry"), [(500, 0.85), (30, -0.9), (3, 0.0), (3, 0.85)]
)
def test_white_furnace(visibility, asymmetry):
    """White ground, white droplets, a uniform sky: the same radiance everywhere."""
    fog = Fog(visibility, height=60, albedo=1.0, asymmetry=asymmetry)
    field = solve_fog(fog, uniform_light(2.0), np.ones(3))
    np.testing.assert_allclose(field.radiance, 2.0, rtol=5e-3)
    np.testing.assert_allclose(field.source, 2.0, rtol=5e-3)


def test_first_scattering_of_the_sun_alone_matches_quadrature():
    """Black ground, no sky, weakly scattering droplets: what is seen was scattered once."""
    altitude = np.radians(30)
    sun = np.array([np.cos(altitude), 0, np.sin(altitude)])
    light = Light(sun, np.ones(3), np.zeros((128, 256, 3)))
    fog = Fog(visibility=20, height=40, albedo=1e-4, asymmetry=0.5)
    field = solve_fog(fog, light, np.zeros(3))
    for row, column in ((2, 5), (9, 20), (15, 0), (21, 16)):
        d = DIRECTIONS[row, column]
        level = 0 if d[2] > 0 else LEVELS - 1
        near = field.heights[level]

        def gained(s: float, d=d, near=near) -> float:
            above = fog.height - (near + s * d[2])
            return fog.extinction * np.exp(-fog.extinction * (s + above / sun[2]))

        length = fog.height / abs(d[2])
        (phase,) = henyey_greenstein(np.array([d @ sun]), fog.asymmetry)
        expected = fog.albedo * phase * quad(gained, 0, length, limit=200)[0]
        # 3 %: the phase function is made to keep energy on a grid of 24 × 32 directions.
        assert field.radiance[level, row, column, 0] == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("asymmetry", [-0.99, -0.5, 0.0, 0.85, 0.99])
def test_the_phase_function_integrates_to_one_with_mean_cosine_g(asymmetry):
    def moment(power: int) -> float:
        return quad(
            lambda c: 2 * np.pi * henyey_greenstein(np.array([c]), asymmetry)[0] * c**power,
            -1,
            1,
            points=[-0.99, 0.99],
            limit=500,
        )[0]

    assert moment(0) == pytest.approx(1, rel=1e-6)
    assert moment(1) == pytest.approx(asymmetry, abs=1e-6)


@pytest.mark.parametrize(
    "fog",
    [
        Fog(visibility=60, height=0),
        Fog(visibility=1e9),
        Fog(visibility=0.1, height=60),
        Fog(visibility=0.3, height=20, albedo=1.0),
        Fog(visibility=60, height=1e5),
        Fog(visibility=60, asymmetry=0.99),
        Fog(visibility=60, asymmetry=-0.99),
    ],
    ids=str,
)
@pytest.mark.parametrize("altitude", [90, 0.01, -10])
def test_hard_cases_stay_finite_and_not_negative(fog, altitude):
    field = solve_fog(fog, make_light(Weather(sun_altitude=altitude), GROUND), GROUND)
    for values in (field.radiance, field.source, field.sun):
        assert np.isfinite(values).all()
    assert (field.sun >= 0).all()
    assert field.radiance.min() >= -1e-3 * field.radiance.max()


@pytest.mark.parametrize("stretch", [1.0, 2.5, 6.0])
def test_levels_fill_the_layer_and_are_densest_at_its_ends(stretch):
    heights = level_heights(60.0, stretch)
    assert heights[0] == pytest.approx(0, abs=1e-9)
    assert heights[-1] == pytest.approx(60)
    steps = np.diff(heights)
    assert (steps > 0).all()
    assert steps[0] == pytest.approx(steps.min())
    assert steps[0] == pytest.approx(steps[-1])


@pytest.mark.parametrize("altitude", [40, -5])
def test_droplets_that_hardly_scatter_scatter_once(altitude):
    """``single`` lacks what the field has at order ϖ², and is linear in ϖ."""
    light = make_light(Weather(sun_altitude=altitude), GROUND)

    def solved(albedo: float, model: str) -> FogField:
        return solve_fog(Fog(60, height=60, albedo=albedo), light, GROUND, model)

    field, single = (solved(1e-3, model) for model in ("field", "single"))
    # What is scattered twice: less than ϖ of what comes in, sun included.
    bound = 1e-3 * 1e-3 * (light.sky.max() + light.sun_irradiance.max())
    np.testing.assert_allclose(single.source, field.source, rtol=0.01, atol=bound)
    np.testing.assert_allclose(single.radiance, field.radiance, rtol=0.01, atol=bound)
    np.testing.assert_allclose(solved(0.5, "single").source, 500 * single.source, rtol=1e-9)
    assert single.source.max() > 10 * bound, "once is far more than twice"


def test_what_is_scattered_more_than_once_is_light_that_single_lacks():
    light = make_light(Weather(sun_altitude=40), GROUND)
    field, single = (solve_fog(Fog(60, 60), light, GROUND, m) for m in ("field", "single"))
    assert (field.source > single.source).all()
    assert field.source.mean() > 2 * single.source.mean()


def test_airlight_is_koschmieders_law():
    """I = T · sky + (1 − T) · A downwards; A is the mean light, of a furnace its radiance."""
    fog = Fog(visibility=100, height=50, albedo=0.8)
    furnace = solve_fog(fog, uniform_light(2.0), np.ones(3), "airlight")
    np.testing.assert_allclose(furnace.airlight, 0.8 * 2.0, rtol=1e-6)
    transmittance = np.exp(-fog.extinction * fog.height / DIRECTIONS[: ROWS // 2, :, 2])[..., None]
    expected = 2.0 * transmittance + 1.6 * (1 - transmittance)
    expected = np.broadcast_to(expected, furnace.radiance[0, : ROWS // 2].shape)
    np.testing.assert_allclose(furnace.radiance[0, : ROWS // 2], expected, rtol=1e-6)
    sunlit = Light(np.array([0.6, 0.0, 0.8]), np.array([4 * np.pi, 0, 0]), np.zeros((128, 256, 3)))
    airlight = solve_fog(fog, sunlit, np.zeros(3), "airlight").airlight
    np.testing.assert_allclose(airlight, [0.8, 0, 0])
