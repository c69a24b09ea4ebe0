"""Fog at the price of clear air: time against clear air, bias and gradient against Mitsuba's.

    python benchmarks/fog.py scenes/etron_fog.yaml -o docs/fog.json

For each visibility, sun altitude and light (sun and sky, sun alone) it prints one row, measured in
four parts that --only chooses among (a row keeps the parts that OUT holds already):

time: processor seconds of the first picture; forward and backward as ratios of processor time to
clear air, taken in turn.

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

import numpy as np
from fog_against_mitsuba import SAMPLES, block_pattern, camera, error, prbvolpath
from tables import markdown

from cnca import build
from cnca.core.files import write_text
from cnca.core.manifest import versions
from cnca.effects.fog import FogEffect
from cnca.mi_bridge.fog import solve_fog
from cnca.mi_bridge.light import make_light
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.scene.load_scene import load_scene
from cnca.scene.weather import Fog, Weather

TIMED, TIMED_SIZE = 9, 256


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
    renderer = build.build_path_tracer(scene, build.build_vehicle(scene), samples=SAMPLES)
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
        write_text(options.out, json.dumps(content, indent=1) + "\n")
    print(table(rows))


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
            started = time.process_time()
            loss = renderer.render(texture, views, now, seed=turn).square().mean()
            middle = time.process_time()
            loss.backward()
            if turn == 0 and foggy:  # kernels, sky and fog are made on the first turn
                first = middle - started
            if turn > 0:
                seconds.setdefault((foggy, "forward"), []).append(middle - started)
                seconds.setdefault((foggy, "backward"), []).append(time.process_time() - middle)
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
    for model in FogEffect.models[1:]:
        seconds = []
        for _ in range(TIMED):
            started = time.process_time()
            solve_fog(weather.fog, light, renderer.ground_albedo, model)
            seconds.append(time.process_time() - started)
        medians[f"solve_{model}"] = round(float(np.median(seconds)), 3)
    return medians


PARTS = {"time": timing, "solver": solver, "error": error, "prbvolpath": prbvolpath}


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

    cells = [[cell(column, row) for column in COLUMNS.values()] for row in rows]
    return "\n".join(markdown(list(COLUMNS), cells))


if __name__ == "__main__":
    main()
