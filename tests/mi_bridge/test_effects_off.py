"""What is off costs nothing: seen in the kernels, not on a clock."""

from __future__ import annotations

import gc
import subprocess
import sys
from dataclasses import replace

import pytest
import torch

from cnca.effects.plan import Demand
from cnca.mi_bridge import integrator
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.mi_bridge.variant import dr
from cnca.scene.materials import MATERIALS
from cnca.scene.weather import Fog, Weather
from cnca.vehicle.builtin.props import box
from cnca.vehicle.model import Vehicle
from tests.mi_bridge.conftest import BOX, orbit

SUNNY, DUSK = Weather(sun_altitude=40), Weather(sun_altitude=-2)
FOGGY = Weather(sun_altitude=40, fog=Fog(60.0, 60.0))
PATH_TRACER = 2000
"""Operations beyond which a kernel is one that follows paths."""


def make_kernels(vehicle: Vehicle):
    """Return what gives the path tracer's kernels in a render, with or without its gradient."""
    renderer = MitsubaRenderer(vehicle, texture_size=8, samples=4)

    def of(weather: Weather, *, learns: bool = False, **forced: str) -> list[dict]:
        demand = Demand(forced={"samples": 4, **forced})
        gc.collect()  # kernels hold the code of all materials that exist, whoever made them
        texture = torch.full((3, 8, 8), 0.5, requires_grad=learns)
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
            image = renderer.render(texture, [orbit()], weather, seed=0, demand=demand)
            if image.requires_grad:
                image.sum().backward()
            history = dr.kernel_history([dr.KernelType.JIT])
        return [k for k in history if k["operation_count"] > PATH_TRACER]

    return of


@pytest.fixture(scope="module")
def kernels(vehicle):
    return make_kernels(vehicle)


def code(kernel: dict) -> str:
    return kernel["ir"].getvalue()


def rays(kernel: dict) -> int:
    """How often the kernel calls the ray tracer."""
    return code(kernel).count("call void %")


def test_clear_air_holds_no_fog_code(kernels):
    """The kernel of fog that is left out is the very kernel of clear air, and a smaller one."""
    (clear,), (left_out,), (fog,) = kernels(SUNNY), kernels(FOGGY, fog="none"), kernels(FOGGY)
    assert left_out["hash"] == clear["hash"]
    assert clear["operation_count"] < fog["operation_count"]
    assert len(code(clear)) < len(code(fog))


def test_simpler_fog_has_smaller_kernels(kernels):
    """One airlight is not looked up; only the whole field knows what the vehicle scatters."""
    models = ("none", "airlight", "single", "field")
    counts = [kernels(FOGGY, fog=model)[0]["operation_count"] for model in models]
    assert counts == sorted(set(counts))


def test_without_sun_no_shadow_ray_is_traced(kernels):
    (sunny,), (dusk,), (off,) = kernels(SUNNY), kernels(DUSK), kernels(SUNNY, sun="off")
    assert (rays(sunny), rays(dusk)) == (2, 1)
    assert off["hash"] == dusk["hash"]


def test_a_direction_holds_no_code_of_the_disc(kernels):
    (direction,), (disc,) = kernels(SUNNY), kernels(SUNNY, sun="disc")
    assert rays(direction) == rays(disc)
    assert direction["operation_count"] < disc["operation_count"]


def test_without_sky_no_map_is_looked_up(kernels):
    (sky,), (none,) = kernels(SUNNY), kernels(SUNNY, sky="off")
    assert none["operation_count"] < sky["operation_count"]


@pytest.mark.parametrize(("glass", "traced"), [("pane", True), ("dark", False)])
def test_dark_glass_holds_no_code_of_panes(monkeypatch, glass, traced):
    calls, original = [], integrator.pane_transmittance
    monkeypatch.setattr(
        integrator, "pane_transmittance", lambda *given: calls.append(1) or original(*given)
    )
    window = replace(box(BOX / 2), material="glass", name="window")
    clear = replace(MATERIALS["glass"], transmission=0.5)
    kernels = make_kernels(Vehicle("box", (box(BOX), window), glass=clear))
    assert kernels(SUNNY, glass=glass)
    assert bool(calls) == traced


def print_sizes_by_material() -> None:
    kernels = make_kernels(Vehicle("box", (box(BOX),)))
    for model in ("diffuse", "principled", "coat"):
        print(kernels(SUNNY, materials=model)[0]["operation_count"])


def test_simpler_materials_have_smaller_kernels():
    counts = [int(line) for line in lines_of("print_sizes_by_material()")]
    assert counts[0] < counts[1] < counts[2]


def lines_of(call: str) -> list[str]:
    """What a function of this file prints in a process of its own.

    Here the other tests' renderers are alive with their materials, which all kernels hold.
    """
    code = f"import {__name__} as here; here.{call}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.split()


def test_without_gradient_no_adjoint_runs(kernels):
    (image,), (refused,) = kernels(SUNNY), kernels(SUNNY, learns=True, gradient="off")
    assert refused["hash"] == image["hash"]
    again, adjoint = kernels(SUNNY, learns=True)
    assert again["hash"] == image["hash"]
    assert rays(adjoint) == rays(image), "the path is walked once"
