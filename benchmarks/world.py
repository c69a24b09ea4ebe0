"""What a world costs a step of the attack, and how far its kept light lies from its geometry.

    python benchmarks/world.py

price       processor seconds of rendering one view, forward and backward, in the built-in street
            over those on the plane, each in a process of its own, in turn
cosine      of the texture's gradient through the kept light against that through all geometry
error       of the vehicle's pixels, √mean((L − L_ref)² / (L_ref² + 0.01)), L_ref by all geometry
bias        of the vehicle's mean light against Mitsuba's volpath in the street, in fog of 100 m
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import torch
from stopwatch import Goal, named_rows, parser, report

from cnca import build
from cnca.effects.effect import Model
from cnca.effects.plan import Demand
from cnca.effects.world import GEOMETRY
from cnca.mi_bridge.backgrounds import KeptBackgrounds
from cnca.mi_bridge.portions import vehicle_part
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.mi_bridge.volpath import exposed_volpath
from cnca.scene.cameras import View, orbit_view
from cnca.scene.load_scene import load_scene
from cnca.scene.schema import Scene
from cnca.scene.weather import Fog

SIZE = 320
REPEATS = 8
"""Pictures by volpath, whose means differ by 4 % at 64 rays."""
STREET = "builtin:street_day"


def main() -> None:
    """Measure and report, or take the steps that another process asked for."""
    options = _options()
    if options.steps_of:
        take_steps(options.steps_of == "street", options.turns)
        return
    scene = load_scene(STREET)
    if options.only == "fog":
        print(f"bias in fog against volpath: {fog_bias(scene, options.spp):+.4f}")
        return
    fidelity = {rung: errors(scene, rung, options.spp) for rung in ("backdrop", "probe")}
    price = prices(options.turns)
    fog = fog_bias(scene, options.spp)
    rows = {
        rung: {
            "relative RMSE": f"{error:.3f}",
            "cosine of the gradient": f"{cosine:.4f}",
            "bias of the mean": f"{bias:+.2%}",
        }
        for rung, (error, cosine, bias) in fidelity.items()
    }
    ratio = price["street"] / price["plane"]
    measured = {"price": price, "fidelity": fidelity, "fog": fog}
    goals = [
        Goal("street step over plane step", round(ratio, 3), 1.2),
        Goal("cosine of the probe's gradient", round(fidelity["probe"][1], 4), 0.99, at_least=True),
        Goal("bias in fog against volpath", round(abs(fog), 4), 0.05),
    ]
    report(options, "world", measured, goals, [named_rows("the vehicle's light by", rows)])


def _options() -> argparse.Namespace:
    options = parser(__doc__)
    options.add_argument("--turns", type=int, default=9, help="steps of each kind")
    options.add_argument("--spp", type=int, default=256, help="rays per pixel of the comparisons")
    options.add_argument("--only", choices=("fog",), help="print the bias in fog alone")
    # By this the benchmark starts itself.
    options.add_argument("--steps-of", choices=("street", "plane"), help=argparse.SUPPRESS)
    return options.parse_args()


def prices(turns: int) -> dict[str, float]:
    """Median processor seconds of a step; two processes take their steps in turn."""
    command = [sys.executable, __file__, "--turns", str(turns), "--steps-of"]
    processes = {
        name: subprocess.Popen(
            [*command, name], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        for name in ("plane", "street")
    }
    seconds: dict[str, list[float]] = {name: [] for name in processes}
    for turn in range(turns + 1):
        for name, process in processes.items():
            assert process.stdin is not None
            assert process.stdout is not None
            print(turn, file=process.stdin, flush=True)
            spent = float(process.stdout.readline())
            if turn > 0:  # the first makes kernels, background and probe
                seconds[name].append(spent)
    for process in processes.values():
        process.communicate()
    return {name: float(np.median(spent)) for name, spent in seconds.items()}


def take_steps(in_street: bool, turns: int) -> None:
    """Render a view forward and backward whenever a line comes in, and answer its seconds."""
    scene = load_scene(STREET)
    renderer, albedo = loop(scene if in_street else scene.model_copy(update={"world": None}))
    for turn in range(turns + 1):
        sys.stdin.readline()
        texture, started = albedo.clone().requires_grad_(), time.process_time()
        renderer.render(texture, [view()], scene.weather(), seed=turn).sum().backward()
        print(time.process_time() - started, flush=True)


def loop(scene: Scene) -> tuple[KeptBackgrounds, torch.Tensor]:
    """The renderer of an attack, and the plain paint."""
    vehicle = build.build_vehicle(scene)
    paint = build.build_paint(scene, vehicle)
    renderer = build.build_loop_renderer(scene, vehicle, paint, backend="mitsuba", samples=16)
    assert isinstance(renderer, KeptBackgrounds)
    return renderer, paint.apply()


def view() -> View:
    """A view of the vehicle from the front."""
    return orbit_view(35, 12, 7.5, fov=45, width=SIZE, height=SIZE)


def traced(scene: Scene, **forced: Model) -> MitsubaRenderer:
    """The path tracer with these models."""
    return build.build_path_tracer(scene, build.build_vehicle(scene), demand=Demand(forced=forced))


def errors(scene: Scene, rung: str, samples: int) -> tuple[float, float, float]:
    """Error, cosine of the gradient, and bias of the mean, of the vehicle's pixels."""
    kept, albedo = loop(scene)
    background = kept.background(view(), scene.weather())
    pixels = background.pixels
    light, gradients = [], []
    for model in (rung, GEOMETRY):
        renderer = traced(scene, surroundings=model, interreflection=3)
        texture = albedo.clone().requires_grad_()
        vehicle = renderer.render_pixels(
            texture,
            [view()],
            scene.weather(),
            pixels,
            seed=1,
            samples=samples,
            portion=vehicle_part(background.shares),
        )
        vehicle.sum().backward()
        light.append(vehicle.detach())
        gradients.append(texture.grad.flatten())
    L, L_ref = light
    error = ((L - L_ref).square() / (L_ref.square() + 0.01)).mean().sqrt()
    cosine = torch.nn.functional.cosine_similarity(*gradients, dim=0)
    return float(error), float(cosine), float(L.mean() / L_ref.mean() - 1)


@torch.no_grad()
def fog_bias(scene: Scene, samples: int) -> float:
    """Of the vehicle's mean light through fog of 100 m, against volpath."""
    fog = Fog(visibility=100.0, height=60.0)
    small, weather = replace(view(), width=80, height=80), replace(scene.weather(), fog=fog)
    kept, albedo = loop(scene)
    renderer = traced(scene, interreflection=8)
    covered = renderer.vehicle_mask([small])[0] == 1
    ours = kept.traced(small, weather)[0].numpy()[:, covered].mean()
    theirs = [
        exposed_volpath(renderer, albedo, small, weather, samples=samples, seed=seed)
        for seed in range(REPEATS)
    ]
    return float(ours / np.mean([picture[0].numpy()[:, covered] for picture in theirs]) - 1)


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main()
