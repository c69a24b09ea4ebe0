"""Gradients through the renderer, wherever binding a texture to a scene has gone wrong before."""

from __future__ import annotations

import gc
import weakref

import pytest
import torch

from cnca.core.errors import TextureError
from cnca.mi_bridge import memory
from cnca.mi_bridge import renderer as renderer_module
from cnca.mi_bridge.bridge import BACKWARD_SEED
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.mi_bridge.variant import dr
from cnca.scene.weather import Fog, Weather
from tests.mi_bridge.conftest import orbit

CLEAR = Weather()
FOGGY = Weather(fog=Fog(visibility=60.0, height=60.0))
WEATHERS = pytest.mark.parametrize("weather", [CLEAR, FOGGY], ids=["clear", "fog"])
SEED = 7


def random_texture(seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(3, 8, 8, generator=generator) * 0.8 + 0.1


def gradient(renderer, texture, weather=CLEAR, seed=SEED, view=None) -> torch.Tensor:
    texture = texture.detach().clone().requires_grad_()
    renderer.render(texture, [view or orbit()], weather, seed=seed).sum().backward()
    return texture.grad


def assert_same(a: torch.Tensor, b: torch.Tensor) -> None:
    """Equal but for the order in which parallel sums were taken."""
    torch.testing.assert_close(a, b, rtol=1e-4, atol=1e-4 * float(b.abs().max()))


@WEATHERS
def test_two_renders_and_one_backward_give_the_sum(backend, weather):
    texture = random_texture().requires_grad_()
    first = backend.render(texture, [orbit(35)], weather, seed=1)
    second = backend.render(texture, [orbit(200)], weather, seed=2)
    (first.sum() + second.sum()).backward()
    separate = gradient(backend, texture, weather, 1, orbit(35))
    separate = separate + gradient(backend, texture, weather, 2, orbit(200))
    assert_same(texture.grad, separate)


def test_a_render_without_gradient_in_between_changes_nothing(backend):
    texture = random_texture().requires_grad_()
    image = backend.render(texture, [orbit()], CLEAR, seed=SEED)
    with torch.no_grad():
        backend.render(random_texture(1), [orbit(200)], CLEAR, seed=3)
    image.sum().backward()
    assert_same(texture.grad, gradient(backend, texture))


@WEATHERS
def test_another_weather_and_texture_before_backward_change_nothing(backend, weather):
    texture = random_texture().requires_grad_()
    image = backend.render(texture, [orbit()], weather, seed=SEED)
    noon = Weather(sun_altitude=80, sun_scale=10, fog=Fog(20.0, 10.0))
    backend.render(random_texture(1).requires_grad_(), [orbit(200)], noon, seed=3)
    image.sum().backward()
    assert_same(texture.grad, gradient(backend, texture, weather))


@pytest.mark.parametrize("kind", ["parameter", "float64", "bfloat16", "not contiguous"])
def test_every_kind_of_tensor_gets_a_gradient_of_its_own_kind(backend, kind):
    plain = random_texture().bfloat16().float()  # the same value in each precision
    make = {
        "parameter": torch.nn.Parameter,
        "float64": lambda t: t.double().requires_grad_(),
        "bfloat16": lambda t: t.bfloat16().requires_grad_(),
        "not contiguous": lambda t: t.transpose(1, 2).contiguous().transpose(1, 2).requires_grad_(),
    }
    texture = make[kind](plain.clone())
    backend.render(texture, [orbit()], CLEAR, seed=SEED).sum().backward()
    assert texture.grad.dtype == texture.dtype
    expected = gradient(backend, plain).to(texture.dtype)
    torch.testing.assert_close(texture.grad, expected, rtol=1e-2, atol=1e-3)


@WEATHERS
def test_same_seed_same_image_bit_for_bit(backend, weather):
    def render(seed: int) -> torch.Tensor:
        return backend.render(random_texture(), [orbit()], weather, seed=seed)

    assert torch.equal(render(5), render(5))


@WEATHERS
def test_another_seed_gives_other_noise(renderer, weather):
    images = [renderer.render(random_texture(), [orbit()], weather, seed=s) for s in (5, 6)]
    assert not torch.equal(*images)


def change_by_differences(renderer, low, high, weather, seeds) -> float:
    """Mean of the image's sum under ``high`` minus that under ``low``, with common noise."""
    with torch.no_grad():
        sums = [
            [renderer.render(t, [orbit()], weather, seed=s).double().sum() for t in (high, low)]
            for s in seeds
        ]
    return float(sum(high - low for high, low in sums)) / len(seeds)


def change_by_gradient(renderer, texture, step, weather, seeds) -> float:
    """The same to first order: the gradient, averaged over seeds, times the step."""
    slopes = [(gradient(renderer, texture, weather, s).double() * step).sum() for s in seeds]
    return float(sum(slopes)) / len(seeds)


@WEATHERS
def test_gradient_of_a_patch_meets_central_differences(backend, weather):
    texture, step = random_texture(), torch.zeros(3, 8, 8)
    step[:, 2:5, 0:6] = 0.05
    seeds = range(12)
    expected = change_by_differences(backend, texture - step, texture + step, weather, seeds)
    found = change_by_gradient(backend, texture, 2 * step, weather, seeds)
    assert found == pytest.approx(expected, rel=0.02)


@WEATHERS
def test_gradient_is_the_derivative_of_a_picture_of_the_same_long_paths(vehicle, weather):
    """Of one that the backward pass's own random numbers draw; so no noise stands between them."""
    renderer = MitsubaRenderer(vehicle, texture_size=8, samples=16, bounces=4)
    texture, step = random_texture(), 0.02 * (random_texture(1) - 0.5)
    pair, paths = (texture - step, texture + step), [SEED + BACKWARD_SEED]
    expected = change_by_differences(renderer, *pair, weather, paths)
    found = change_by_gradient(renderer, texture, 2 * step, weather, [SEED])
    assert found == pytest.approx(expected, rel=1e-3)


@WEATHERS
@pytest.mark.parametrize("edge", [0.0, 1.0])
def test_gradient_is_right_at_the_ends_of_the_range(backend, weather, edge):
    texture = torch.full((3, 8, 8), edge)
    step = torch.full((3, 8, 8), 0.04 if edge == 0 else -0.04)
    seeds = range(12)
    expected = change_by_differences(backend, texture, texture + step, weather, seeds)
    found = change_by_gradient(backend, texture, step, weather, seeds)
    assert abs(expected) > 0.1
    assert found == pytest.approx(expected, rel=0.03)


def test_new_seeds_views_and_weathers_need_no_new_kernels_and_no_memory(renderer):
    def work(i: int) -> None:
        fog = Fog(visibility=40.0 + i, height=50.0 + i) if i % 2 else None
        weather = Weather(sun_altitude=30.0 + i, sun_azimuth=10.0 * i, fog=fog)
        gradient(renderer, random_texture(i), weather, i, orbit(40.0 * i, 10.0 + i))

    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        for i in range(4):
            work(i)
        dr.kernel_history_clear()
        variables = len(dr.whos(as_string=True).splitlines())
        renderer.built.atmosphere.cache_clear()
        for i in range(4, 12):
            work(i)
        kernels = [k for k in dr.kernel_history() if k["type"] == dr.KernelType.JIT]
        renderer.built.atmosphere.cache_clear()
        gc.collect()
    assert kernels
    assert not [kernel["operation_count"] for kernel in kernels if not kernel["cache_hit"]]
    assert len(dr.whos(as_string=True).splitlines()) <= variables


def test_a_render_is_forgotten_once_its_image_is(renderer, monkeypatch):
    shots = []

    class RememberedShot(renderer_module.Shot):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            shots.append(weakref.ref(self))

    monkeypatch.setattr(renderer_module, "Shot", RememberedShot)
    gradient(renderer, random_texture())
    gc.collect()
    assert [shot() for shot in shots] == [None]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [(float("nan"), "nan"), (-0.5, "-0.5"), (1.5, "1.5"), (float("inf"), "inf")],
)
def test_textures_outside_the_unit_range_are_refused(backend, spoil, message):
    texture = random_texture()
    texture[1, 2, 3] = spoil
    with pytest.raises(TextureError, match=message):
        backend.render(texture, [orbit()], CLEAR, seed=0)


def test_textures_of_another_size_are_refused(backend):
    with pytest.raises(TextureError, match=r"\(3, 4, 4\).*\(3, 8, 8\)"):
        backend.render(torch.zeros(3, 4, 4), [orbit()], CLEAR, seed=0)


def test_a_picture_of_many_samples_is_rendered_in_parts(renderer, monkeypatch):
    """Parts go on with one evenly spread set: their mean is as good as the whole."""
    texture, view = random_texture(), orbit()
    whole = renderer.render(texture, [view], CLEAR, seed=SEED)
    whole_gradient = gradient(renderer, texture)
    monkeypatch.setattr(memory, "MOST_RAYS", view.width * view.height * 24)
    parts = renderer.render(texture, [view], CLEAR, seed=SEED)
    assert not torch.equal(parts, whole)
    other = renderer.render(texture, [view], CLEAR, seed=SEED + 1)
    assert (parts - whole).square().mean() < (other - whole).square().mean()
    similarity = torch.nn.functional.cosine_similarity
    assert similarity(gradient(renderer, texture).ravel(), whole_gradient.ravel(), dim=0) > 0.99
