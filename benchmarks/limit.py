"""How near rendering is to bare ray casting, and how its time grows.

    python benchmarks/limit.py

The floor is a loop over the same camera rays that finds their first hits and does nothing else. One
size is changed at a time; ``exponent`` is the slope of log time over log size through all points:
1 is proportional, below it fixed costs are shared. Seconds are processor seconds of all threads.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib
import numpy as np
import torch
import trimesh
from stopwatch import in_turn, named_rows, parser, report

from cnca import build
from cnca.core.files import replacing
from cnca.mi_bridge.rays import Cameras
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.mi_bridge.variant import dr, mi
from cnca.scene.load_scene import load_scene
from cnca.scene.schema import Scene
from cnca.scene.variation import draw_views
from cnca.vehicle.model import Part, Vehicle

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.ticker import EngFormatter

SCENE = Path("scenes/sedan_clear.yaml")
WORK = ("floor", "forward", "forward + backward")


@dataclass(frozen=True)
class Size:
    """What one measurement renders."""

    side: int = 96
    samples: int = 16
    views: int = 4
    subdivisions: int = 0
    texels: int = 512

    @property
    def rays(self) -> int:
        """Primary rays."""
        return self.views * self.side**2 * self.samples


AXES: dict[str, list[Size]] = {
    "pixels": [Size(side=side) for side in (24, 48, 96, 192)],
    "samples": [Size(samples=n) for n in (4, 16, 64)],
    "views": [Size(views=n) for n in (1, 4, 16)],
    "triangles": [Size(subdivisions=n) for n in (0, 1, 2, 3)],
    "texels": [Size(texels=n) for n in (128, 512, 2048)],
}


class Bench:
    """One scene at any size."""

    def __init__(self, turns: int) -> None:
        self.turns = turns
        self.scene: Scene = load_scene(SCENE)
        self.vehicle = build.build_vehicle(self.scene)

    def measure(self, size: Size) -> dict[str, float]:
        """Processor seconds of the three kinds of work, and the number of triangles."""
        vehicle = subdivided(self.vehicle, size.subdivisions)
        renderer = MitsubaRenderer(vehicle, texture_size=size.texels, samples=size.samples)
        drawn = draw_views(self.scene, size.views, seed=0)
        views = [replace(view, width=size.side, height=size.side) for view in drawn]
        cameras = Cameras([renderer.geometry.local(view) for view in views])
        weather, grey = self.scene.weather(), torch.full((3, size.texels, size.texels), 0.5)

        def floor(seed: int) -> None:
            ray, _ = cameras.rays(size.samples, dr.opaque(mi.UInt32, seed))
            hit = renderer.geometry.scene.ray_intersect_preliminary(ray, coherent=True)
            dr.eval(hit.t)
            dr.sync_thread()

        def forward(seed: int) -> None:
            with torch.no_grad():
                renderer.render(grey, views, weather, seed=seed)

        def both(seed: int) -> None:
            albedo = grey.clone().requires_grad_()
            renderer.render(albedo, views, weather, seed=seed).sum().backward()

        calls: list[Callable[[int], None]] = [floor, forward, both]
        costs, _ = in_turn(dict(zip(WORK, calls, strict=True)), self.turns)
        triangles = sum(len(part.faces) for part in vehicle.parts)
        return {name: costs[name].cpu for name in WORK} | {"triangles": triangles}


def subdivided(vehicle: Vehicle, times: int) -> Vehicle:
    """The same surface from four times as many triangles, ``times`` over."""

    def finer(part: Part) -> Part:
        attributes = {"normals": part.normals}
        if part.uvs is not None:
            attributes["uvs"] = part.uvs
        vertices, faces, more = trimesh.remesh.subdivide(
            part.vertices, part.faces, vertex_attributes=attributes
        )
        return replace(part, vertices=vertices, faces=faces, **more)

    for _ in range(times):
        vehicle = replace(vehicle, parts=tuple(finer(part) for part in vehicle.parts))
    return vehicle


def abscissa(axis: str, size: Size, row: dict[str, float]) -> float:
    """The number that an axis changes."""
    number = {
        "pixels": size.side**2,
        "samples": size.samples,
        "views": size.views,
        "triangles": row["triangles"],
        "texels": size.texels**2,
    }
    return number[axis]


def exponent(x: list[float], y: list[float]) -> float:
    """Slope of the line through the logarithms."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def curves(
    rows: dict[Size, dict[str, float]],
) -> Iterator[tuple[str, str, list[float], list[float]]]:
    """Axis, kind of work, sizes and seconds."""
    for axis, sizes in AXES.items():
        x = [abscissa(axis, size, rows[size]) for size in sizes]
        for work in WORK:
            yield axis, work, x, [rows[size][work] for size in sizes]


def draw(path: Path, rows: dict[Size, dict[str, float]]) -> None:
    """Time over each size, both logarithmic."""
    figure, frames = plt.subplots(1, len(AXES), figsize=(15, 3.4), sharey=True)
    by_axis = dict(zip(AXES, frames, strict=True))
    for axis, work, x, y in curves(rows):
        label = f"{work}: {exponent(x, y):.2f}"
        frame = by_axis[axis]
        frame.loglog(x, y, marker="o", markersize=3, label=label)
        frame.set_xticks(x, [EngFormatter(sep="")(size) for size in x], fontsize=7)
        frame.minorticks_off()
    for axis, frame in by_axis.items():
        frame.set_xlabel(axis)
        frame.grid(which="both", alpha=0.2)
        above = {"loc": "lower center", "bbox_to_anchor": (0.5, 1)}
        frame.legend(title="exponent", fontsize=7, title_fontsize=7, **above)
    frames[0].set_ylabel("processor seconds")
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=90, bbox_inches="tight")
    plt.close(figure)


def main() -> None:
    """Measure every size once, however many axes it lies on."""
    arguments = parser(__doc__)
    arguments.add_argument("--turns", type=int, default=2)
    options = arguments.parse_args()
    bench, rows = Bench(options.turns), {}
    for size in {size: None for sizes in AXES.values() for size in sizes}:
        rows[size] = bench.measure(size)
    usual = Size()
    rate = {work: round(usual.rays / rows[usual][work] / 1e6, 3) for work in WORK}
    exponents: dict[str, dict[str, float]] = {axis: {} for axis in AXES}
    for axis, work, x, y in curves(rows):
        exponents[axis][work] = round(exponent(x, y), 2)
    floors = {work: round(rate["floor"] / rate[work], 2) for work in WORK}
    measured = {
        "million rays per processor second": rate,
        "times the floor": floors,
        "exponents": exponents,
        "seconds": [vars(size) | {k: round(v, 4) for k, v in rows[size].items()} for size in rows],
    }
    pictures = options.document.parent / "images" if options.document else options.out
    draw(pictures / "limit.png", rows)
    usual_size = {"million rays per processor second": rate, "times the floor": floors}
    tables = named_rows("", usual_size), named_rows("exponent in", exponents)
    report(options, "limit", measured, [], tables)


if __name__ == "__main__":
    main()
