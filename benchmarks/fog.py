"""Fog at the price of clear air: time against clear air, bias and gradient against Mitsuba's.

    python benchmarks/fog.py scenes/etron_fog.yaml -o docs/fog.json

For each visibility, sun altitude and light (sun and sky, sun alone) it prints one row, measured in
four parts that --only chooses among (a row keeps the parts that OUT holds already):

time: seconds of the first picture; forward and backward as ratios to clear air, taken in turn.

solver: processor seconds that the fog's solution takes, for each of its models.

error: bias of the mean over the vehicle's pixels with its standard error; cosine and relative
length of the texture's gradient along random block patterns, the reference's by finite differences
of ``volpath``; and how often longer ``volpath`` alone, which gives no gradient, takes to the same
error of a pixel.

prbvolpath: how often longer Mitsuba's differentiable volumetric path tracer takes, forward and
backward, to the same error of a pixel and to the same error of the texture's gradient.  It needs
the biases that the part before it finds.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import TypeVar

import numpy as np
import torch

from cnca import build
from cnca.manifest import versions
from cnca.mi_bridge.fog import solve_fog
from cnca.mi_bridge.light import make_light
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.mi_bridge.volpath import PrbVolpath, exposed_volpath
from cnca.scene.cameras import View, orbit_view
from cnca.scene.effects import LADDERS
from cnca.scene.schema import load_scene
from cnca.scene.weather import Fog, Weather

TIMED, TIMED_SIZE, SAMPLES = 5, 256, 16
STEP = 0.2
"""Change of the albedo for finite differences; the picture is nearly linear in it."""
OURS = 8
"""Renders of ours whose scatter is its noise."""
Found = TypeVar("Found")


def main() -> None:
    """Measure every combination and print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", type=Path)
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--visibility", type=float, nargs="+", default=[500, 100, 30])
    parser.add_argument("--altitude", type=float, nargs="+", default=[60, 10])
    parser.add_argument("--light", choices=["sunsky", "sun"], nargs="+", default=["sunsky", "sun"])
    parser.add_argument("--only", choices=list(PARTS), nargs="+", default=list(PARTS))
    parser.add_argument("--distance", type=float, default=7.0)
    parser.add_argument("--size", type=int, default=48)
    parser.add_argument("--spp", type=int, default=512, help="rays of one reference render")
    parser.add_argument("--runs", type=int, default=4, help="independent reference renders")
    parser.add_argument("--patterns", type=int, default=6)
    options = parser.parse_args()

    scene = load_scene(options.scene)
    renderer = build.build_renderer(scene, build.build_vehicle(scene), samples=SAMPLES)
    assert isinstance(renderer, MitsubaRenderer)
    known = json.loads(options.out.read_text()) if options.out.exists() else {}
    rows, commands = known.get("rows", []), known.get("made_by", [])
    commands.append(" ".join(["python", *sys.argv]))
    keys = product(options.light, options.altitude, options.visibility)
    for light, altitude, visibility in keys:
        weather = Weather(
            sun_altitude=altitude,
            sun_azimuth=75.0,
            sky_scale=1.0 if light == "sunsky" else 0.0,
            fog=Fog(visibility, height=60.0),
        )
        key = {"light": light, "altitude": altitude, "visibility": visibility}
        row = next((row for row in rows if row.items() >= key.items()), None)
        if row is None:
            row = key
            rows.append(row)
        for part in (part for part in PARTS if part in options.only):
            row |= PARTS[part](renderer, weather, options, row)
        print(json.dumps(row), flush=True)
        content = {"made_by": commands, "versions": versions(), "rows": rows}
        options.out.write_text(json.dumps(content, indent=1) + "\n")
    print(table(rows))


def camera(options: argparse.Namespace, size: int) -> View:
    """A view from the front left, inside the fog."""
    return orbit_view(35, 12, options.distance, fov=45.0, width=size, height=size)


def timing(
    renderer: MitsubaRenderer, weather: Weather, options: argparse.Namespace, row: dict
) -> dict:
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


def solver(
    renderer: MitsubaRenderer, weather: Weather, options: argparse.Namespace, row: dict
) -> dict:
    """Median processor seconds of the solution by each model."""
    light = make_light(weather, renderer.ground_albedo)
    assert weather.fog is not None
    medians = {}
    for model in LADDERS["fog"][1:]:
        seconds = []
        for _ in range(TIMED):
            started = time.process_time()
            solve_fog(weather.fog, light, renderer.ground_albedo, model)
            seconds.append(time.process_time() - started)
        medians[f"solve_{model}"] = round(float(np.median(seconds)), 3)
    return medians


class Bench:
    """One foggy view of a grey vehicle, and the pixels and weights that a loss would take."""

    def __init__(
        self, renderer: MitsubaRenderer, weather: Weather, options: argparse.Namespace
    ) -> None:
        self.renderer, self.weather, self.spp = renderer, weather, options.spp
        self.view = camera(options, options.size)
        self.where = renderer.vehicle_mask([self.view])[0] == 1
        self.weights = np.random.default_rng(1).uniform(0.5, 1.5, (int(self.where.sum()), 3))
        size = renderer.geometry.texture_size
        self.grey = torch.full((3, size, size), 0.5)

    def pixels(self, images: torch.Tensor) -> torch.Tensor:
        """The vehicle's pixels of the mean picture."""
        return images.mean(dim=0).permute(1, 2, 0)[torch.from_numpy(self.where)]

    def volpath(self, texture: torch.Tensor, seed: int) -> np.ndarray:
        """The vehicle's pixels by Mitsuba's ``volpath``."""
        return self.pixels(
            exposed_volpath(
                self.renderer, texture, self.view, self.weather, samples=self.spp, seed=seed
            )
        ).numpy()

    def ours(self, seed: int, renders: int = 1) -> tuple[np.ndarray, torch.Tensor]:
        """The vehicle's pixels by ``renders`` of ours, and the gradient of their weighted mean."""
        texture = self.grey.clone().requires_grad_()
        images = [
            self.renderer.render(texture, [self.view], self.weather, seed=renders * seed + k)
            for k in range(renders)
        ]
        chosen = self.pixels(torch.cat(images))
        (chosen * torch.from_numpy(self.weights).float()).mean().backward()
        assert texture.grad is not None
        return chosen.detach().numpy(), texture.grad


def error(
    renderer: MitsubaRenderer, weather: Weather, options: argparse.Namespace, row: dict
) -> dict:
    """Bias, gradient and time to equal error against ``volpath``."""
    bench, runs = Bench(renderer, weather, options), range(options.runs)
    patterns = [block_pattern(renderer, 1 + k) - 0.5 for k in range(options.patterns)]
    started = time.perf_counter()
    expected = np.array([bench.volpath(bench.grey, seed) for seed in runs])
    reference_seconds = (time.perf_counter() - started) / options.runs
    slopes = []
    for pattern in patterns:  # the same seed on both sides: the noise cancels
        up, down = (bench.volpath(bench.grey + sign * STEP * pattern, 0) for sign in (1, -1))
        slopes.append(((up - down) * bench.weights).mean() / (2 * STEP))

    pictures, gradients = zip(*(bench.ours(seed, OURS) for seed in runs), strict=True)
    seconds = []
    for seed in runs:
        started = time.perf_counter()
        with torch.no_grad():
            renderer.render(bench.grey, [bench.view], weather, seed=seed)
        seconds.append(time.perf_counter() - started)
    found, slope = np.array(pictures), np.array(slopes)
    gradient = np.mean([[float((g * p).sum()) for p in patterns] for g in gradients], axis=0)
    bias = found.mean() / expected.mean() - 1
    error = np.hypot(*(x.mean(axis=(1, 2)).std(ddof=1) for x in (found, expected)))
    # Squared error of a pixel: ours at 16 rays with its bias, the reference's noise at its rays.
    ours = found.var(axis=0, ddof=1).mean() * OURS + (bias * expected.mean()) ** 2
    theirs = expected.var(axis=0, ddof=1).mean()
    return {
        "bias": round(float(bias), 4),
        "bias_error": round(float(error / expected.mean() / np.sqrt(options.runs)), 4),
        "gradient_cosine": round(float(cosine(gradient, slope)), 4),
        "gradient_length": round(float(np.linalg.norm(gradient) / np.linalg.norm(slope)), 4),
        "volpath_time": round(float(reference_seconds * theirs / ours / np.median(seconds)), 1),
    }


def prbvolpath(
    renderer: MitsubaRenderer, weather: Weather, options: argparse.Namespace, row: dict
) -> dict:
    """Squared error × time of Mitsuba's differentiable tracer over ours.

    Both trace equally many rays for their times, so that fixed costs weigh alike: ours as a larger
    picture of 16 rays per pixel.  Ours has its bias besides its noise: of the picture and of the
    gradient as the part ``error`` found them.
    """
    bench, runs = Bench(renderer, weather, options), range(1, 1 + options.runs)
    first = renderer.shots(
        renderer.plan(bench.grey, [bench.view], weather), [bench.view], None, seed=0
    )[0]
    exposure = float(np.array(first.exposure)[0])
    assert weather.fog is not None
    tracer = PrbVolpath(renderer.geometry, first.surroundings.sky.light, weather.fog, bench.view)
    adjoint = np.zeros((*bench.where.shape, 3))
    adjoint[bench.where] = exposure * bench.weights / bench.weights.size
    grey = bench.grey.permute(1, 2, 0).numpy()

    def theirs(seed: int) -> tuple[np.ndarray, np.ndarray]:
        picture = exposure * tracer.picture(options.spp, seed)[bench.where]
        return picture, tracer.gradient(grey, adjoint, options.spp, seed + 1000)

    large = camera(options, round(options.size * (options.spp / SAMPLES) ** 0.5))

    def timed(seed: int) -> None:
        texture = bench.grey.clone().requires_grad_()
        renderer.render(texture, [large], weather, seed=seed).square().mean().backward()

    theirs_found, theirs_seconds = stopwatch(theirs, runs)
    _, ours_seconds = stopwatch(timed, runs)
    ours_found = [bench.ours(seed) for seed in range(OURS)]
    pictures, gradients = (np.array([pair[k] for pair in theirs_found]) for k in (0, 1))
    our_pictures = np.array([picture for picture, _ in ours_found])
    our_gradients = np.array([gradient.numpy() for _, gradient in ours_found])
    length, cos = row["gradient_length"], row["gradient_cosine"]
    bias = {
        "picture": (row["bias"] * our_pictures.mean()) ** 2,
        # |g − g*|² of a gradient of relative length l at an angle, per texel.
        "gradient": (1 + length**2 - 2 * length * cos) * shared_square(our_gradients) / length**2,
    }
    noise = {"picture": (pictures, our_pictures), "gradient": (gradients, our_gradients)}
    rays = options.spp * theirs_seconds / (SAMPLES * ours_seconds)
    factors = {}
    for what, (a, b) in noise.items():
        squares = a.var(axis=0, ddof=1).mean() / (b.var(axis=0, ddof=1).mean() + bias[what])
        factors[f"prbvolpath_{what}"] = round(float(squares * rays), 1)
    return factors


def shared_square(gradients: np.ndarray) -> float:
    """Mean square of what independent gradients have in common."""
    mean = gradients.mean(axis=0)
    return float((mean**2).mean() - gradients.var(axis=0, ddof=1).mean() / len(gradients))


def stopwatch(call: Callable[[int], Found], seeds: range) -> tuple[list[Found], float]:
    """Results for the seeds and the median seconds of a call; the first one, untimed, compiles."""
    call(0)
    found, seconds = [], []
    for seed in seeds:
        started = time.perf_counter()
        found.append(call(seed))
        seconds.append(time.perf_counter() - started)
    return found, float(np.median(seconds))


PARTS = {"time": timing, "solver": solver, "error": error, "prbvolpath": prbvolpath}


def cosine(a: np.ndarray, b: np.ndarray) -> float:
    """Cosine of the angle between two vectors."""
    return float(a @ b / np.linalg.norm(a) / np.linalg.norm(b))


def block_pattern(renderer: MitsubaRenderer, seed: int, blocks: int = 4) -> torch.Tensor:
    """Albedo of 0 and 1 in random squares."""
    chance = torch.Generator().manual_seed(seed)
    squares = torch.randint(2, (1, 3, blocks, blocks), generator=chance).float()
    size = renderer.geometry.texture_size
    return torch.nn.functional.interpolate(squares, size=(size, size), mode="nearest")[0]


COLUMNS = {
    "light": lambda r: {"sunsky": "sun and sky", "sun": "sun alone"}[r["light"]],
    "sun": lambda r: f"{r['altitude']:g}°",
    "visibility": lambda r: f"{r['visibility']:g} m",
    "forward": lambda r: f"{r['forward']:.2f}",
    "backward": lambda r: f"{r['backward']:.2f}",
    "bias on the vehicle": lambda r: f"{r['bias']:+.1%} ± {r['bias_error']:.1%}",
    "gradient cosine": lambda r: f"{r['gradient_cosine']:.4f}",
    "length": lambda r: f"{r['gradient_length']:.2f}",
    "`volpath` takes": lambda r: f"{r['volpath_time']:.0f} ×",
    "`prbvolpath`: picture": lambda r: f"{r['prbvolpath_picture']:.0f} ×",
    "gradient": lambda r: f"{r['prbvolpath_gradient']:.0f} ×",
}
"""Heading → cell of a row, which is empty where that part was not measured."""


def table(rows: list[dict]) -> str:
    """The rows as Markdown."""

    def cell(column: Callable[[dict], str], row: dict) -> str:
        try:
            return column(row)
        except KeyError:
            return ""

    lines = ["| " + " | ".join(COLUMNS) + " |", "|" + "---|" * len(COLUMNS)]
    for row in rows:
        lines.append("| " + " | ".join(cell(column, row) for column in COLUMNS.values()) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
