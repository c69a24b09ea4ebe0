"""A budget of memory: many rays are traced in parts that fit."""

import os

import pytest
import torch

from cnca.core.errors import BackendError
from cnca.mi_bridge import memory
from cnca.mi_bridge.bridge import render
from cnca.mi_bridge.variant import dr
from cnca.scene.weather import Fog, Weather
from tests.mi_bridge.conftest import orbit

VIEW = orbit(width=128, height=128)
"""With the renderer's 64 rays per pixel about a million of them."""
BUDGET = 128 * 128 * 4 * memory.BYTES
"""For four rays per pixel at once."""
LLVM = dr.JitBackend.LLVM


def taken(work) -> int:
    """Most bytes that Dr.Jit held during ``work`` beyond what it held before."""
    dr.sync_thread()
    dr.flush_malloc_cache()
    dr.detail.malloc_clear_statistics()
    before = dr.detail.malloc_watermark(LLVM)
    work()
    dr.sync_thread()
    return dr.detail.malloc_watermark(LLVM) - before


@pytest.mark.skipif(os.environ.get("CNCA_VARIANT") == "cuda_ad_rgb", reason="counts main memory")
@pytest.mark.parametrize("fog", [None, Fog(60.0, 60.0)], ids=["clear", "fog"])
def test_rays_and_their_gradient_stay_within_the_budget(renderer, monkeypatch, fog):
    def work():
        albedo = torch.full((3, 8, 8), 0.5, requires_grad=True)
        renderer.render(albedo, [VIEW], Weather(fog=fog), seed=1).sum().backward()

    work()  # weather and texture are there from now on
    assert taken(work) > BUDGET
    monkeypatch.setenv(memory.BUDGET, str(BUDGET))
    assert taken(work) < BUDGET


def test_a_picture_is_the_mean_of_its_parts_and_so_is_its_gradient(renderer, monkeypatch):
    monkeypatch.setenv(memory.BUDGET, f"{16 * 16 * 24 * memory.BYTES / 1e6}MB")
    texture, weather = torch.rand(3, 8, 8, generator=torch.Generator().manual_seed(0)), Weather()
    plan = renderer.plan(texture, [orbit()], weather)
    shots = renderer.shots(plan, [orbit()], None, seed=3)
    assert [(shot.first, shot.samples) for shot in shots] == [(0, 24), (24, 24), (48, 16)]

    def outcome(shots) -> tuple[torch.Tensor, torch.Tensor]:
        albedo = texture.permute(1, 2, 0).clone().requires_grad_()
        image = render(albedo, shots)
        image.square().sum().backward()  # a gradient that is not the same everywhere
        return image.detach(), albedo.grad

    whole, _ = outcome(shots)
    parts = torch.stack([outcome([shot])[0] * shot.samples for shot in shots]).sum(dim=0) / 64
    # Sums of a few numbers in another order.
    assert torch.allclose(whole, parts, rtol=1e-5, atol=1e-6)

    albedo = texture.permute(1, 2, 0).clone().requires_grad_()
    sum(render(albedo, [shot]) * shot.samples for shot in shots).div(64).square().sum().backward()
    gradient = outcome(shots)[1]
    assert torch.allclose(gradient, albedo.grad, rtol=1e-4, atol=1e-4 * float(gradient.abs().max()))


def test_too_small_a_budget_says_what_is_needed(renderer, monkeypatch):
    monkeypatch.setenv(memory.BUDGET, "500KiB")
    message = r"^--memory-budget 500KiB: one ray for each of 16384 pixels takes 0.8 MiB"
    with pytest.raises(BackendError, match=message):
        renderer.render(torch.zeros(3, 8, 8), [VIEW], Weather(), seed=0)


@pytest.mark.parametrize("size", ["much", "2 apples", "-1GiB", "GiB", "2gib"])
def test_a_budget_that_is_no_size_is_refused(monkeypatch, size):
    monkeypatch.setenv(memory.BUDGET, size)
    with pytest.raises(BackendError, match=f"^--memory-budget {size}: give a size such as 500MiB"):
        memory.samples_at_once(1)


@pytest.mark.parametrize(("size", "rays"), [("5000", 100), ("1 KiB", 20), ("0.5MB", 10_000)])
def test_sizes(monkeypatch, size, rays):
    monkeypatch.setenv(memory.BUDGET, size)
    assert memory.samples_at_once(1) == rays
    assert memory.samples_at_once(1, most_rays=7) == 7


def test_rays_without_room_are_refused_before_they_crash(renderer, monkeypatch):
    monkeypatch.setattr(memory, "BYTES", 2**40)  # a ray: together more than any address space
    with pytest.raises(BackendError, match="^no memory for 1048576 rays at once"):
        renderer.render(torch.zeros(3, 8, 8), [VIEW], Weather(), seed=0)
