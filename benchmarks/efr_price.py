"""What the shipped EFR adds to the time of the raster backend, in the loop that keeps its views.

    python benchmarks/efr_price.py --document docs/backends.md

A render of four views with its backward pass, with and without EFR in turn, by processor seconds on
one thread: what a view costs once it is kept (kernels, shading and corrections are made before).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import torch
from stopwatch import Goal, in_turn, named_rows, parser, report

from cnca import build
from cnca.judge.held_out import HELD_OUT_SEED
from cnca.scene.load_scene import load_scene
from cnca.scene.protocols import Residual
from cnca.scene.variation import draw_views

SCENES = (Path("scenes/sedan_clear.yaml"), Path("scenes/sedan_fog.yaml"))
VIEWS, TURNS = 4, 100


def measure(path: Path, residual: Residual) -> dict[str, float]:
    """Processor milliseconds a view, without and with EFR, and what it adds in percent."""
    scene = load_scene(path)
    vehicle = build.build_vehicle(scene)
    paint = build.build_paint(scene, vehicle)
    loop = build.build_loop_renderer(scene, vehicle, paint, backend="raster", samples=16)
    views, weather = draw_views(scene, VIEWS, seed=HELD_OUT_SEED), scene.weather()
    adjoint = torch.rand(VIEWS, 3, scene.image.height, scene.image.width)

    def step(residual: Residual | None) -> Callable[[int], None]:
        def one(seed: int) -> None:
            albedo = paint.apply().requires_grad_()
            images = loop.render(albedo, views, weather, seed=seed)
            if residual is not None:
                images = residual(images, loop.reference(views, weather, seed=seed))
            (images * adjoint).sum().backward()

        return one

    costs, _ = in_turn({"raster": step(None), "with EFR": step(residual)}, TURNS)
    each = {name: round(1e3 * cost.cpu / VIEWS, 2) for name, cost in costs.items()}
    return each | {"percent": round(100 * (each["with EFR"] / each["raster"] - 1), 1)}


def main() -> None:
    """Measure both scenes."""
    options = parser(__doc__).parse_args()
    torch.set_num_threads(1)
    residual = build.build_residual(Path("builtin"))
    assert residual is not None
    measured = {path.stem: measure(path, residual) for path in SCENES}
    goals = [
        Goal(f"{name}: time that EFR adds, percent", row["percent"], 10)
        for name, row in measured.items()
    ]
    report(options, "efr_price", measured, goals, [named_rows("ms a view", measured)])


if __name__ == "__main__":
    main()
