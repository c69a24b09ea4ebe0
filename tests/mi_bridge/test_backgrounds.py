"""Pictures with a kept background against pictures that are rendered whole."""

from __future__ import annotations

import pytest
import torch

from cnca.mi_bridge.backgrounds import KeptBackgrounds
from cnca.scene.protocols import Renderer
from cnca.scene.weather import Fog, Weather
from tests.mi_bridge.conftest import orbit

VIEWS = [orbit(35, 15, 6), orbit(200, 10, 6)]
PLAIN = torch.full((3, 8, 8), 0.4)


def texture() -> torch.Tensor:
    return torch.rand(3, 8, 8, generator=torch.Generator().manual_seed(0))


@pytest.mark.parametrize("weather", [Weather(), Weather(fog=Fog(60))], ids=["clear", "fog"])
def test_vehicle_anew_background_kept(renderer, weather):
    kept = KeptBackgrounds(renderer, PLAIN)
    assert isinstance(kept, Renderer)
    first = kept.render(PLAIN, VIEWS, weather, seed=1)
    images = kept.render(texture(), VIEWS, weather, seed=1)
    whole = renderer.render(texture(), VIEWS, weather, seed=2)
    on_vehicle = torch.from_numpy(renderer.vehicle_mask(VIEWS) > 0)[:, None].expand_as(images)
    torch.testing.assert_close(images[~on_vehicle], first[~on_vehicle])
    around = renderer.render(PLAIN, VIEWS, weather, seed=4)[~on_vehicle]
    assert first[~on_vehicle].mean() == pytest.approx(around.mean().item(), rel=0.02)
    assert (images[on_vehicle] != first[on_vehicle]).float().mean() > 0.9
    again = renderer.render(texture(), VIEWS, weather, seed=3)
    noise = (whole - again)[on_vehicle].square().mean().sqrt() / 2**0.5
    difference = (images - whole)[on_vehicle].square().mean().sqrt() / 2**0.5
    assert difference < 1.2 * noise


def test_the_gradient_is_that_of_the_vehicles_pixels(renderer):
    on_vehicle = torch.from_numpy(renderer.vehicle_mask(VIEWS) > 0)[:, None]
    gradients = []
    for each in (KeptBackgrounds(renderer, PLAIN), renderer):
        albedo = texture().requires_grad_()
        for seed in range(4):
            (each.render(albedo, VIEWS, Weather(), seed=seed) * on_vehicle).mean().backward()
        gradients.append(albedo.grad.flatten())
    kept, whole = gradients
    assert torch.cosine_similarity(kept, whole, dim=0) > 0.999
    assert kept.norm() == pytest.approx(whole.norm().item(), rel=0.01)


def test_each_view_and_weather_is_rendered_whole_but_once(renderer, monkeypatch):
    kept, calls = KeptBackgrounds(renderer, PLAIN), []
    render = renderer.render
    monkeypatch.setattr(
        renderer, "render", lambda *args, **more: calls.append(args[1]) or render(*args, **more)
    )
    for seed, views in enumerate((VIEWS[:1], VIEWS, VIEWS)):
        kept.render(PLAIN, views, Weather(), seed=seed)
    kept.render(PLAIN, VIEWS[:1], Weather(sun_altitude=30), seed=5)
    assert calls == [VIEWS[:1], VIEWS[1:], VIEWS[:1]]


def test_a_picture_does_not_depend_on_what_was_kept_before(renderer):
    """A resumed loop starts without backgrounds and goes on as if it had not been interrupted."""
    begun, resumed = (KeptBackgrounds(renderer, PLAIN) for _ in range(2))
    begun.render(PLAIN, VIEWS[1:], Weather(), seed=7)
    pictures = [kept.render(texture(), VIEWS, Weather(), seed=8) for kept in (begun, resumed)]
    assert torch.equal(*pictures)


def test_boxes_are_those_of_the_renderer(renderer):
    kept = KeptBackgrounds(renderer, PLAIN)
    for _ in range(2):
        assert torch.equal(kept.vehicle_boxes(VIEWS), renderer.vehicle_boxes(VIEWS))
