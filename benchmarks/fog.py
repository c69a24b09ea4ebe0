"""Fog at the price of clear air: time against clear air, bias and gradient against ``volpath``.

    python benchmarks/fog.py scenes/etron_fog.yaml -o docs/fog.json

For each visibility, sun altitude and light (sun and sky, sun alone) it prints one row: seconds to
solve the field; time of forward and backward as ratios to clear air, taken in turn; bias of the
mean over the vehicle's pixels with its standard error; cosine and relative length of the texture's
gradient along random block patterns, the reference's by finite differences of ``volpath``; and how
often longer ``volpath`` alone, which gives no gradient, takes to the same error of a pixel.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import torch

from cnca import build
from cnca.manifest import versions
from cnca.mi_bridge.light import lambertian_white, make_light
from cnca.mi_bridge.rays import Cameras
from cnca.mi_bridge.reference import volpath_picture
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.scene.cameras import View, orbit_view
from cnca.scene.schema import load_scene
from cnca.scene.weather import Fog, Weather

TIMED, TIMED_SIZE, SAMPLES = 5, 256, 16
STEP = 0.2
"""Change of the albedo for finite differences; the picture is nearly linear in it."""


def main() -> None:
    """Measure every combination and print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", type=Path)
    parser.add_argument("-o", "--out", type=Path)
    parser.add_argument("--visibility", type=float, nargs="+", default=[500, 100, 30])
    parser.add_argument("--altitude", type=float, nargs="+", default=[60, 10])
    parser.add_argument("--light", choices=["sunsky", "sun"], nargs="+", default=["sunsky", "sun"])
    parser.add_argument("--distance", type=float, default=7.0)
    parser.add_argument("--size", type=int, default=48)
    parser.add_argument("--spp", type=int, default=512, help="rays of one reference render")
    parser.add_argument("--runs", type=int, default=4, help="independent reference renders")
    parser.add_argument("--patterns", type=int, default=6)
    options = parser.parse_args()

    scene = load_scene(options.scene)
    renderer = build.build_renderer(scene, build.build_vehicle(scene), samples=SAMPLES)
    assert isinstance(renderer, MitsubaRenderer)
    rows = []
    keys = product(options.light, options.altitude, options.visibility)
    for light, altitude, visibility in keys:
        weather = Weather(
            sun_altitude=altitude,
            sun_azimuth=75.0,
            sky_scale=1.0 if light == "sunsky" else 0.0,
            fog=Fog(visibility, height=60.0),
        )
        row = {"light": light, "altitude": altitude, "visibility": visibility}
        rows.append(row | timing(renderer, weather, options) | accuracy(renderer, weather, options))
        # volpath itself gives NaN now and then: null says so, and nothing is left out in silence.
        rows[-1] = {k: None if v != v else v for k, v in rows[-1].items()}
        print(json.dumps(rows[-1]), flush=True)
    print(table(rows))
    if options.out:
        content = {"options": vars(options), "versions": versions(), "rows": rows}
        options.out.write_text(json.dumps(content, indent=1, default=str) + "\n")


def camera(options: argparse.Namespace, size: int) -> View:
    """A view from the front left, inside the fog."""
    return orbit_view(35, 12, options.distance, fov=45.0, width=size, height=size)


def timing(renderer: MitsubaRenderer, weather: Weather, options: argparse.Namespace) -> dict:
    """Medians of forward and backward in fog over those in clear air, one after the other."""
    views = [camera(options, TIMED_SIZE)]
    seconds: dict[tuple[bool, str], list[float]] = {}
    for turn in range(TIMED + 1):
        for foggy in (False, True):
            now = weather if foggy else replace(weather, fog=None)
            texture = block_pattern(renderer, 0).requires_grad_()
            started = time.perf_counter()
            loss = renderer.render(texture, views, now, seed=turn).square().mean()
            middle = time.perf_counter()
            loss.backward()
            if turn == 0 and foggy:  # kernels, sky and fog are made on the first turn
                first = middle - started
            if turn > 0:
                seconds.setdefault((foggy, "forward"), []).append(middle - started)
                seconds.setdefault((foggy, "backward"), []).append(time.perf_counter() - middle)
    median = {key: float(np.median(values)) for key, values in seconds.items()}
    return {
        "first_seconds": round(first, 2),
        "forward": round(median[True, "forward"] / median[False, "forward"], 3),
        "backward": round(median[True, "backward"] / median[False, "backward"], 3),
    }


def accuracy(renderer: MitsubaRenderer, weather: Weather, options: argparse.Namespace) -> dict:
    """Bias, gradient and time to equal error against ``volpath``."""
    view = camera(options, options.size)
    fog, light = weather.fog, make_light(weather, renderer.ground_albedo)
    light = light.scaled(1 / lambertian_white(light.sky, light.sun_irradiance, light.sun_direction))
    assert fog is not None
    where = renderer.vehicle_mask([view])[0] == 1
    weights = np.random.default_rng(1).uniform(0.5, 1.5, (int(where.sum()), 3))
    grey = torch.full((3, renderer.geometry.texture_size, renderer.geometry.texture_size), 0.5)
    patterns = [block_pattern(renderer, 1 + k) - 0.5 for k in range(options.patterns)]
    exposure = renderer._atmosphere(weather, "direction").exposure * renderer.exposure

    def reference(texture: torch.Tensor, seed: int) -> np.ndarray:
        renderer.render(texture, [view], weather, seed=0)  # binds the texture
        cameras = Cameras([renderer.geometry.local(view)])
        picture = volpath_picture(
            renderer.geometry.scene, light, fog, cameras, samples=options.spp, seed=seed
        )
        return exposure * picture[0][where]

    started = time.perf_counter()
    expected = np.array([reference(grey, seed) for seed in range(options.runs)])
    reference_seconds = (time.perf_counter() - started) / options.runs
    slopes = []
    for pattern in patterns:  # the same seed on both sides: the noise cancels
        up, down = (reference(grey + sign * STEP * pattern, 0) for sign in (1, -1))
        slopes.append(((up - down) * weights).mean() / (2 * STEP))

    runs, seconds, gradients = [], [], []
    for seed in range(options.runs):
        texture = grey.clone().requires_grad_()
        images = [renderer.render(texture, [view], weather, seed=8 * seed + k) for k in range(8)]
        chosen = torch.stack(images).mean(dim=0)[0].permute(1, 2, 0)[torch.from_numpy(where)]
        (chosen * torch.from_numpy(weights).float()).mean().backward()
        gradients.append([float((texture.grad * p).sum()) for p in patterns])
        runs.append(chosen.detach().numpy())
        started = time.perf_counter()
        with torch.no_grad():
            renderer.render(grey, [view], weather, seed=seed)
        seconds.append(time.perf_counter() - started)
    found, gradient, slope = np.array(runs), np.mean(gradients, axis=0), np.array(slopes)
    bias = found.mean() / expected.mean() - 1
    error = np.hypot(*(x.mean(axis=(1, 2)).std(ddof=1) for x in (found, expected)))
    # Squared error of a pixel: ours at 16 rays with its bias, the reference's noise at its rays.
    ours = found.var(axis=0, ddof=1).mean() * 8 + (bias * expected.mean()) ** 2
    theirs = expected.var(axis=0, ddof=1).mean()
    return {
        "bias": round(float(bias), 4),
        "bias_error": round(float(error / expected.mean() / np.sqrt(options.runs)), 4),
        "gradient_cosine": round(float(cosine(gradient, slope)), 4),
        "gradient_length": round(float(np.linalg.norm(gradient) / np.linalg.norm(slope)), 4),
        "volpath_time": round(float(reference_seconds * theirs / ours / np.median(seconds)), 1),
    }


def cosine(a: np.ndarray, b: np.ndarray) -> float:
    """Cosine of the angle between two vectors."""
    return float(a @ b / np.linalg.norm(a) / np.linalg.norm(b))


def block_pattern(renderer: MitsubaRenderer, seed: int, blocks: int = 4) -> torch.Tensor:
    """Albedo of 0 and 1 in random squares."""
    chance = torch.Generator().manual_seed(seed)
    squares = torch.randint(2, (1, 3, blocks, blocks), generator=chance).float()
    size = renderer.geometry.texture_size
    return torch.nn.functional.interpolate(squares, size=(size, size), mode="nearest")[0]


def table(rows: list[dict]) -> str:
    """The rows as Markdown."""
    names = list(rows[0])
    lines = ["| " + " | ".join(names) + " |", "|" + "---|" * len(names)]
    return "\n".join([*lines, *("| " + " | ".join(str(r[n]) for n in names) + " |" for r in rows)])


if __name__ == "__main__":
    main()
