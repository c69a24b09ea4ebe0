"""A step's rendering against what others do: seconds, memory and error of the texture's gradient.

    python benchmarks/peers.py

One step renders a few views of a random texture and takes the gradient of the attack's loss in it,
through the adjoint pictures that the loss sends back from a clean picture. In turn:

ours          the loop's renderer: the vehicle's pixels over kept backgrounds, all views at once
ours, whole   the same integrator on whole pictures
batch AD      REVAMP's way: Mitsuba's ``path`` of depth 12 by plain AD, all views in a batch sensor
script        ``dr.wrap`` around ``mi.render`` with ``prb``, in fog ``prbvolpath``, view after view

All see the same shapes, materials, sun, sky, fog, rays per pixel. ``error`` is the relative squared
error of the gradient, √(|g − g*|² / |g*|²), against g*: long runs of the last, which are
independent and have no bias of ours. ``as_good`` is the time that a method takes to reach the
squared error of ours, over the time of ours: squared error × time, for noise falls with the number
of rays. Memory is the most that Dr.Jit held during a step beyond what it held before.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import torch
from plain_mitsuba import BatchAD, Script
from stopwatch import Goal, in_turn, named_rows, parser, report
from torch import Tensor

from cnca import build
from cnca.attack.objectives import paper
from cnca.attack.targets import look, weighted_loss
from cnca.core.color import linear_to_srgb
from cnca.mi_bridge.backgrounds import KeptBackgrounds
from cnca.mi_bridge.variant import dr
from cnca.scene.load_scene import load_scene
from cnca.scene.variation import draw_views

CLEAN = 64
"""Rays per pixel of the picture that the adjoint pictures belong to."""
HALF_SEED = 10_000
"""Between the seeds of the reference's halves, and of the steps that are timed."""

Step = Callable[[int], Tensor]
"""Seed → gradient of the texture (3, size, size)."""


class Bench:
    """Some views of one scene, a texture, and what the loss sends back into the pictures."""

    def __init__(
        self, scene_file: Path, options: argparse.Namespace, views: int, size: int
    ) -> None:
        scene = load_scene(scene_file)
        vehicle = build.build_vehicle(scene)
        paint = build.build_paint(scene, vehicle)
        chance = torch.Generator().manual_seed(0)
        blocks = torch.rand((1, 3, 32, 32), generator=chance)
        texture = torch.nn.functional.interpolate(blocks, size=(scene.vehicle.texture_size,) * 2)[0]
        self.albedo = paint.apply(texture)
        self.views = [replace(v, width=size, height=size) for v in draw_views(scene, views, seed=0)]
        self.weather, self.samples = scene.weather(), options.spp
        kept = build.build_loop_renderer(
            scene, vehicle, paint, backend="mitsuba", samples=options.spp
        )
        assert isinstance(kept, KeptBackgrounds)
        self.kept, self.renderer = kept, kept.renderer
        self.adjoint = self._adjoint()

    def ours(self, seed: int) -> Tensor:
        """A step of the loop."""
        return self._gradient(self.kept, seed)

    def whole(self, seed: int) -> Tensor:
        """A step that renders whole pictures."""
        return self._gradient(self.renderer, seed)

    def _gradient(self, renderer: build.Renderer, seed: int) -> Tensor:
        albedo = self.albedo.clone().requires_grad_()
        images = renderer.render(albedo, self.views, self.weather, seed=seed)
        (images * self.adjoint).sum().backward()
        assert albedo.grad is not None
        return albedo.grad

    def _adjoint(self) -> Tensor:
        """The loss's gradient (views, 3, size, size) at clean linear pictures."""
        chosen = self.renderer.plan(self.albedo, self.views, self.weather)
        passes = range(CLEAN // chosen.samples)
        with torch.no_grad():
            parts = [
                self.renderer.render(self.albedo, self.views, self.weather, seed=seed)
                for seed in passes
            ]
        images = torch.stack(parts).mean(dim=0).requires_grad_()
        targets, boxes = build.build_targets(["builtin"]), self.renderer.vehicle_boxes(self.views)
        seen = look(paper.Loss(), targets, linear_to_srgb(images), boxes)
        weighted_loss(targets, seen).backward()
        assert images.grad is not None
        return images.grad


def squared_error(gradients: Sequence[Tensor], halves: tuple[Tensor, Tensor]) -> float:
    """Mean of |g − g*|² / |g*|²; noise of g* cancels, since its halves are independent."""
    a, b = halves
    products = [float(((g - a) * (g - b)).sum()) for g in gradients]
    return sum(products) / len(products) / float((a * b).sum())


def memory(step: Step) -> float:
    """Megabytes that Dr.Jit took for a step beyond what it held."""
    dr.sync_thread()
    dr.flush_malloc_cache()
    dr.detail.malloc_clear_statistics()
    before = dr.detail.malloc_watermark(dr.JitBackend.LLVM)
    step(HALF_SEED - 1)
    dr.sync_thread()
    return (dr.detail.malloc_watermark(dr.JitBackend.LLVM) - before) / 1e6


def compare(bench: Bench, peers: dict[str, Step], options: argparse.Namespace) -> dict:
    """Rows of all methods; the last of ``peers`` is the reference's."""
    steps: dict[str, Step] = {"ours": bench.ours, "ours, whole": bench.whole, **peers}
    costs, found = in_turn(steps, options.turns)
    reference = list(peers.values())[-1]
    long = [
        torch.stack([reference(half * HALF_SEED + k) for k in range(options.reference)]).mean(dim=0)
        for half in (1, 2)
    ]
    squares = {name: squared_error(found[name], (long[0], long[1])) for name in steps}
    effort = {name: squares[name] * costs[name].cpu for name in steps}
    return {
        name: {
            **{key: round(value, 3) for key, value in asdict(costs[name]).items()},
            "times_ours": round(costs[name].cpu / costs["ours"].cpu, 2),
            "error": round(max(squares[name], 0.0) ** 0.5, 4),
            "as_good": round(effort[name] / effort["ours"], 2),
            "megabytes": round(memory(steps[name]), 1),
        }
        for name in steps
    }


def main() -> None:
    """Measure both scenes."""
    arguments = parser(__doc__)
    arguments.add_argument("--spp", type=int, default=16)
    arguments.add_argument("--turns", type=int, default=3)
    arguments.add_argument("--reference", type=int, default=4, help="steps of each half")
    arguments.add_argument("--clear", type=int, nargs=2, default=(4, 96), metavar=("VIEWS", "PX"))
    arguments.add_argument("--fog", type=int, nargs=2, default=(2, 64), metavar=("VIEWS", "PX"))
    options = arguments.parse_args()

    bench = Bench(Path("scenes/sedan_clear.yaml"), options, *options.clear)
    peers: dict[str, Step] = {"batch AD": BatchAD(bench).step, "script": Script(bench).step}
    clear = compare(bench, peers, options)
    bench = Bench(Path("scenes/sedan_fog.yaml"), options, *options.fog)
    fog = compare(bench, {"script": Script(bench).step}, options)

    batch, script = clear["batch AD"], clear["script"]
    less = batch["megabytes"] / clear["ours"]["megabytes"]
    goals = [
        Goal("clear: batch AD's time over ours", batch["times_ours"], 4, at_least=True),
        Goal("clear: script's time over ours, equal error", script["as_good"], 2, at_least=True),
        Goal("clear: batch AD's memory over ours", round(less, 1), 10, at_least=True),
        Goal(
            "fog: script's time over ours, equal error",
            fog["script"]["as_good"],
            100,
            at_least=True,
        ),
    ]
    settings = {"spp": options.spp, "clear": options.clear, "fog": options.fog}
    measured = settings | {"clear sun": clear, "fog, 60 m": fog}
    tables = named_rows("clear sun", clear), named_rows("fog, 60 m", fog)
    report(options, "peers", measured, goals, tables)


if __name__ == "__main__":
    main()
