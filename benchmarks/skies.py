"""Where it pays to sample a measured sky by its brightness, beside the rays of the materials.

    python benchmarks/skies.py MAP.hdr ...

Prints for each map its contrast, the noise of the sedan's pixels and the processor seconds of a
picture by both models, and noise² × seconds of ``map_mis`` relative to ``map``.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from unittest import mock

import torch
from tables import markdown

from cnca import build
from cnca.effects import daylight
from cnca.effects.plan import Demand
from cnca.scene.schema import Scene
from cnca.scene.views import build_views

SIZE, SAMPLES, RUNS = 96, 16, 6


def measure(file: Path) -> list[str]:
    """One row."""
    scene = Scene.model_validate(
        {
            "sky": {"map": str(file.absolute())},
            "vehicle": {"texture_size": 64},
            "image": {"width": SIZE, "height": SIZE},
        }
    )
    vehicle, views, weather = build.build_vehicle(scene), build_views(scene), scene.weather()
    albedo = build.build_paint(scene, vehicle).apply()
    renderer = build.build_renderer(scene, vehicle)
    mask = torch.from_numpy(renderer.vehicle_mask(views)[0] == 1)
    noise, seconds = {}, {}
    for model in ("map", "map_mis"):
        demand = Demand(forced={"samples": SAMPLES, "sky": model, "gradient": "off"})
        renderer.render(albedo, views, weather, seed=RUNS, demand=demand)  # makes the kernels
        started = time.process_time()
        images = [
            renderer.render(albedo, views, weather, seed=seed, demand=demand)[0][:, mask]
            for seed in range(RUNS)
        ]
        seconds[model] = (time.process_time() - started) / RUNS
        pixels = torch.stack(images)
        noise[model] = float((pixels.std(dim=0) / (pixels.mean(dim=0) + 0.1)).square().mean())
    price = noise["map_mis"] * seconds["map_mis"] / (noise["map"] * seconds["map"])
    numbers = [
        f"{daylight.contrast(weather):.2f}",
        *(f"{noise[m] ** 0.5:.3f}" for m in noise),
        *(f"{seconds[m]:.3f}" for m in seconds),
        f"{price:.2f}",
    ]
    return [file.stem, *numbers]


def main() -> None:
    """Measure every map that is named."""
    heads = ["map", "contrast", "noise, `map`", "`map_mis`", "CPU s, `map`", "`map_mis`", "price"]
    with torch.no_grad(), mock.patch.object(daylight, "MOST_CONTRAST", -1.0):
        rows = [measure(Path(name)) for name in sys.argv[1:]]
    print("\n".join(markdown(heads, rows)))


if __name__ == "__main__":
    main()
