"""Kept shading against the path tracer, Mitsuba's own texture and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from cnca.effects.plan import Demand
from cnca.mi_bridge.affine import AffinePicture, look_up, texel_weights
from cnca.mi_bridge.backgrounds import KeptBackgrounds
from cnca.mi_bridge.light import make_light, sky_directions, sky_solid_angles
from cnca.mi_bridge.lookups import LookupRenderer
from cnca.mi_bridge.raster import PlainShading, matt_white
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.mi_bridge.shading_cache import TracedShading
from cnca.scene.protocols import LoopRenderer, Renderer
from cnca.scene.weather import Fog, Weather
from tests.mi_bridge.conftest import orbit, uniform_light

PLAIN = torch.full((3, 8, 8), 0.4)
WEATHERS = pytest.mark.parametrize(
    "weather", [Weather(), Weather(fog=Fog(60.0, 60.0))], ids=["clear", "fog"]
)


def texture(seed: int = 0) -> torch.Tensor:
    return torch.rand(3, 8, 8, generator=torch.Generator().manual_seed(seed))


def cached(renderer, samples: int = 64, refresh: int | None = None) -> LookupRenderer:
    kept = KeptBackgrounds(renderer, PLAIN)
    return LookupRenderer(kept, TracedShading(kept, samples), refresh)


def test_backends_are_renderers(backend):
    assert isinstance(backend, Renderer)


def test_texel_weights_filter_as_mitsuba_does(renderer):
    view = orbit(width=64, height=64)
    renderer.render(texture(), [view], Weather(), seed=0)
    layers = renderer.layers([view])
    seen = layers.mask[0].ravel() == 1
    uv = layers.uv[0].reshape(-1, 1, 2)[seen] * [1, -1] + [0, 1]
    weights = texel_weights(uv, np.ones((len(uv), 1, 3)), 8)
    found = np.stack([weights[c] @ texture()[c].ravel().numpy() for c in range(3)], axis=-1)
    # Mitsuba's paint starts at ALBEDO_FLOOR = 10⁻³, ours at 0.
    np.testing.assert_allclose(found, layers.albedo[0].reshape(-1, 3)[seen], atol=1.1e-3)


def test_weights_of_equal_texels_are_added():
    """Against a dense sum, over the texture's edge, where it repeats."""
    random = np.random.default_rng(0)
    uv, gain = random.random((5, 7, 2)), random.random((5, 7, 3))
    weights = texel_weights(uv, gain, 3)
    image = texture()[:, :3, :3]
    padded = torch.nn.functional.pad(image[None], (1, 1, 1, 1), mode="circular")
    grid = torch.from_numpy(uv).float()[None] * 2 * 3 / 5 - 3 / 5
    values = torch.nn.functional.grid_sample(padded, grid, align_corners=False)[0]
    expected = (values.permute(1, 2, 0).numpy() * gain).sum(axis=1)
    found = np.stack([weights[c] @ image[c].ravel().numpy() for c in range(3)], axis=-1)
    np.testing.assert_allclose(found, expected, rtol=1e-4)
    assert weights[0].nnz <= 5 * 9


def test_the_gradient_is_exact():
    random = np.random.default_rng(1)
    weights = texel_weights(random.random((4, 3, 2)), random.random((4, 3, 3)), 4)
    picture = AffinePicture(
        random.random((9, 3)).astype(np.float32), np.array([1, 3, 4, 8]), weights
    )
    albedo = torch.rand(3, 4, 4, requires_grad=True)
    step, adjoint = torch.rand(3, 4, 4), torch.rand(2, 9, 3)

    def product(t: torch.Tensor) -> torch.Tensor:
        return (look_up(t, [picture, picture]) * adjoint).sum()

    product(albedo).backward()
    change = product(albedo + step) - product(albedo)
    assert change.item() == pytest.approx((albedo.grad * step).sum().item(), rel=1e-5)


@WEATHERS
def test_cached_pictures_are_those_of_the_path_tracer(renderer, weather):
    """Right to within noise; what the box throws on the ground and back is little."""
    view = orbit(distance=6.0, width=32, height=32)
    found = cached(renderer).render(texture(), [view], weather, seed=0)
    others = [renderer.render(texture(), [view], weather, seed=s) for s in range(1, 5)]
    mask = torch.from_numpy(renderer.vehicle_mask([view]) > 0)[:, None].expand_as(found)
    noise = torch.stack(others).std(dim=0)[mask].square().mean().sqrt()
    error = (found - torch.stack(others).mean(dim=0))[mask]
    assert error.square().mean().sqrt() < 1.3 * noise  # √(1 + 1/4) of noise alone
    assert abs(error.mean()) < 0.01 * others[0][mask].mean()


@WEATHERS
def test_cached_gradients_point_where_the_path_tracers_do(renderer, weather):
    view, gradients = orbit(distance=6.0, width=32, height=32), []
    weights = torch.from_numpy(renderer.vehicle_mask([view]))[:, None] * torch.linspace(0, 1, 32)
    for each in (cached(renderer), renderer):
        albedo = texture().requires_grad_()
        image = each.render(albedo, [view], weather, seed=0)
        (image * weights).sum().backward()
        gradients.append(albedo.grad.flatten())
    found, expected = gradients
    assert torch.cosine_similarity(found, expected, dim=0) > 0.995
    assert found.norm() == pytest.approx(expected.norm().item(), rel=0.02)


def test_the_reference_shares_the_background_of_every_picture(renderer):
    """So that an EFR sees by it where the vehicle is."""
    kept, view = KeptBackgrounds(renderer, PLAIN), orbit(distance=6.0, width=32, height=32)
    reference = kept.traced(view, Weather())
    vehicle = torch.from_numpy(renderer.vehicle_mask([view]) > 0)[:, None].expand_as(reference)
    shadings = PlainShading(kept), TracedShading(kept, 16)
    for loop in (kept, *(LookupRenderer(kept, shading) for shading in shadings)):
        assert isinstance(loop, LoopRenderer)
        (plain,) = loop.reference([view], Weather(), seed=0)
        assert torch.equal(plain.traced, reference)
        assert torch.equal(plain.drawn, loop.render(PLAIN, [view], Weather(), seed=0))
        (again,) = loop.reference([view], Weather(), seed=0)
        assert (again is plain) == (loop is not kept)
        image = loop.render(texture(), [view], Weather(), seed=1)
        assert torch.equal(image[~vehicle], reference[~vehicle])
        assert (image != reference)[vehicle].float().mean() > 0.9
    plain = renderer.render(PLAIN, [view], Weather(), seed=5)[vehicle]
    assert reference[vehicle].mean() == pytest.approx(plain.mean().item(), rel=0.02)


def test_a_black_sky_and_a_sun_alone_are_cached(vehicle):
    renderer = MitsubaRenderer(vehicle, texture_size=8, samples=16, bounces=1)
    for weather in (Weather(sky_scale=0.0), Weather(sun_scale=0.0)):
        found = cached(renderer).render(texture(), [orbit()], weather, seed=0)
        expected = renderer.render(texture(), [orbit()], weather, seed=0)
        assert found.mean() == pytest.approx(expected.mean().item(), rel=0.02)


def test_what_is_kept_changes_only_when_it_is_refreshed(vehicle):
    """The ground sends the paint light that is first the plain paint's, then the new one's."""
    renderer = MitsubaRenderer(vehicle, texture_size=8, samples=16, bounces=3)
    white, black = torch.ones(3, 8, 8), torch.zeros(3, 8, 8)
    refreshed, never = cached(renderer, refresh=2), cached(renderer)
    for each in (refreshed, never):
        for step, albedo in enumerate((white, white, black)):
            each.render(albedo, [orbit()], Weather(), seed=step)
    assert len(never._kept) == 1
    assert torch.equal(
        never.render(white, [orbit()], Weather(), seed=0),
        cached(renderer).render(white, [orbit()], Weather(), seed=9),
    )
    kept = [each.picture(orbit(), Weather(), white) for each in (refreshed, never)]
    dark, plain = (float(sum(w.sum() for w in picture.weights)) for picture in kept)
    assert dark < plain
    assert 0 < never.megabytes < 1


def test_matt_white_under_the_same_light_from_everywhere_is_white():
    normals = sky_directions(8, 16).reshape(-1, 3)
    np.testing.assert_allclose(matt_white(uniform_light(0.7))(normals), 0.7, rtol=1e-3)


def test_matt_white_meets_the_integral_over_the_sky():
    light = make_light(Weather(sun_altitude=30), np.full(3, 0.15))
    normals = sky_directions(6, 12).reshape(-1, 3)
    rows, columns = light.sky.shape[:2]
    cosine = (sky_directions(rows, columns) @ normals.T).clip(min=0)
    weights = sky_solid_angles(rows, columns) * cosine.transpose(2, 0, 1)
    irradiance = np.einsum("nrc,rck->nk", weights, light.sky)
    sun = (normals @ light.sun_direction).clip(min=0)[:, None] * light.sun_irradiance
    expected = (irradiance + sun) / np.pi
    error = matt_white(light)(normals) - expected
    assert np.abs(error).max() < 0.02 * expected.mean()


def test_a_matt_roof_is_shaded_as_the_path_tracer_shades_it(vehicle):
    matt = MitsubaRenderer(
        vehicle, texture_size=8, samples=256, demand=Demand(forced={"materials": "diffuse"})
    )
    kept, view = KeptBackgrounds(matt, PLAIN), orbit(elevation=80, distance=6)
    found = LookupRenderer(kept, PlainShading(kept)).render(texture(), [view], Weather(), seed=0)
    expected = matt.render(texture(), [view], Weather(), seed=1)
    layers = matt.layers([view])
    roof = torch.from_numpy((layers.normal[..., 2] > 0.99) & (layers.mask == 1))
    assert roof.sum() > 20
    ratio = found.sum(dim=1)[roof] / expected.sum(dim=1)[roof]
    assert ratio.mean() == pytest.approx(1.0, abs=0.02)
    assert ratio.std() < 0.03


def test_backgrounds_come_before_any_shading(renderer):
    """A traced world is let go by the first shading: all views of a step are traced before."""
    log, views = [], [orbit(), orbit(azimuth=90)]
    kept = KeptBackgrounds(renderer, PLAIN)
    background, shading = kept.background, TracedShading(kept, 1)

    def look(view, weather):
        log.append("background")
        return background(view, weather)

    def shade(view, weather, albedo):
        log.append("shading")
        return shading(view, weather, albedo)

    kept.background = look
    LookupRenderer(kept, shade).render(texture(), views, Weather(), seed=0)
    assert log[:2] == ["background"] * 2
    assert log.count("shading") == 2
