"""Is a target error met?  Pictures of unseen scenes beside converged references.

    python benchmarks/targets.py --document docs/accuracy.md

One picture of each scene, by one of the targets in turn: random vehicles, paints, grounds, cameras,
suns and fogs (seeds from 7000 on; those of the price list begin at 0), then worlds.  The obtained
error is that of the vehicle's pixels against two independent halves of a reference by the best
models.  A second call goes on where the first was stopped.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from stopwatch import Goal, named_rows, parser, report

from cnca import build
from cnca.core.manifest import write_json
from cnca.core.records import as_json, read_record
from cnca.core.types import LinearTexture
from cnca.effects.proposals import best_models
from cnca.jobs.accuracy.fidelity import root, squared_error, vehicle_pixels
from cnca.jobs.accuracy.random_cases import Case, random_case
from cnca.jobs.accuracy.streams import Streams
from cnca.jobs.accuracy.targets import Scenery, meet
from cnca.scene.load_scene import load_scene
from cnca.scene.views import build_views

FIRST_SEED = 7000
TARGETS = (0.2, 0.1, 0.05, 0.03)
WORLDS = ("street_day", "crossing", "street_fog", "street_wet_night")
RAYS = 128
"""Of a pixel in one step of one half of the reference."""
FINE = 0.15
"""Noise of the reference over the target."""
MOST_STEPS = 48


@dataclass(frozen=True)
class Row:
    """One picture."""

    scene: str
    pixels: int
    """Of the vehicle."""
    target: float
    obtained: float
    uncertainty: float
    """Standard error of what was obtained."""
    measured: float
    """What the picture's own streams said."""
    bias: float
    samples: float
    seconds: float
    pilot_seconds: float
    reference_noise: float
    models: dict[str, str]


def cases(count: int, side: int) -> Iterator[tuple[str, Case]]:
    """Random scenes, then worlds."""
    for seed in range(FIRST_SEED, FIRST_SEED + count):
        case = random_case(seed)
        yield f"random {seed}", replace(case, view=replace(case.view, width=side, height=side))
    for name in WORLDS:
        scene = load_scene(Path("scenes") / f"{name}.yaml")
        paint = build.build_paint(scene, build.build_vehicle(scene)).apply()
        view = replace(build_views(scene)[0], width=side, height=side)
        yield name, Case(scene, paint, view, scene.weather())


def measure(name: str, case: Case, target: float, seed: int) -> Row:
    """Make the picture, then its reference."""
    renderer = build.build_renderer(case.scene, build.build_vehicle(case.scene))
    scenery = Scenery(renderer, LinearTexture(case.albedo), case.view, case.weather, {})
    image, plan, found = meet(scenery, target=target, seed=seed)
    mask = renderer.vehicle_mask([case.view])[0] == 1
    reference = Streams(
        scenery.draw(best_models(plan.subject, {}), RAYS),
        np.flatnonzero(mask),
        rays=RAYS,
        seeds=(1 << 20, (1 << 20) + 1),
    )
    noise = 1.0
    while noise > FINE * target and reference.steps[0] < MOST_STEPS:
        reference.advance(2)
        noise = float(np.sqrt(reference.noise().mean()))
    square, error = squared_error(vehicle_pixels(image, mask), reference.halves)
    obtained = root(square)
    return Row(
        scene=name,
        pixels=int(mask.sum()),
        target=target,
        obtained=obtained,
        uncertainty=error / (2 * max(abs(obtained), 1e-6)),
        measured=found.error,
        bias=found.bias,
        samples=found.samples,
        seconds=found.seconds,
        pilot_seconds=found.pilot_seconds,
        reference_noise=noise,
        models={effect: str(model) for effect, model in plan.models.items()},
    )


def quantiles(rows: list[Row]) -> dict[str, str]:
    """Of obtained over asked."""
    ratios = np.array([row.obtained / row.target for row in rows])
    within = float(np.mean((ratios >= 0.7) & (ratios <= 1.0)))
    shown = {"scenes": f"{len(rows)}"}
    for q in (0, 0.05, 0.5, 0.95, 1):
        shown[{0: "least", 1: "most"}.get(q, f"{q:.0%}")] = f"{np.quantile(ratios, q):.2f}"
    seconds = np.median([row.seconds for row in rows])
    return shown | {"in 0.7 … 1.0": f"{within:.0%}", "CPU s, median": f"{seconds:.1f}"}


def main() -> None:
    """Measure what is not there yet; print and keep the table."""
    arguments = parser(__doc__)
    arguments.add_argument("--scenes", type=int, default=20)
    arguments.add_argument("--side", type=int, default=96)
    options = arguments.parse_args()
    rows = []
    for index, (name, case) in enumerate(cases(options.scenes, options.side)):
        path = options.out / "targets" / f"{name.replace(' ', '_')}.json"
        if not path.exists():
            began = time.process_time()
            row = measure(name, case, TARGETS[index % len(TARGETS)], index)
            path.parent.mkdir(parents=True, exist_ok=True)
            write_json(path, as_json(row))
            ratio = f"{row.obtained / row.target:.2f} ± {row.uncertainty / row.target:.2f}"
            spent = time.process_time() - began
            print(f"{name}: asked {row.target:.0%}, got {ratio} of it ({spent:.0f} s)", flush=True)
        rows.append(read_record(Row, path))
    worlds = [row for row in rows if row.scene in WORLDS]
    groups = {
        **{f"{t:.0%}": [r for r in rows if r.target == t] for t in TARGETS},
        "worlds": worlds,
        "all": rows,
    }
    table = {name: quantiles(group) for name, group in groups.items() if group}
    ratios = np.array([row.obtained / row.target for row in rows])
    goals = [
        Goal(
            "share of pictures with 0.7 to 1.0 of the target",
            float(np.mean((ratios >= 0.7) & (ratios <= 1))),
            0.9,
            at_least=True,
        ),
        Goal("largest obtained over asked", round(float(ratios.max()), 3), 1.1),
    ]
    report(options, "targets", [as_json(r) for r in rows], goals, [named_rows("target", table)])


if __name__ == "__main__":
    main()
