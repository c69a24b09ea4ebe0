"""Prices of the models: what each costs in error and time, measured on random scenes.

In each scene every model below the reference's is rendered in its place, all else as in the
reference, both with the same random numbers; their difference is the model's error.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from rich.console import Console
from scipy.optimize import nnls

from cnca import build
from cnca.core.errors import CncaError, RunError, did_you_mean
from cnca.core.manifest import versions, write_json
from cnca.core.progress import bar
from cnca.core.records import as_json, read_record
from cnca.core.run_folder import RunFolder
from cnca.core.types import LinearTexture
from cnca.effects.catalog import EFFECTS
from cnca.effects.effect import Effect, Model
from cnca.effects.plan import Demand, EffectPlan
from cnca.effects.prices import Calibration, Prices, fit, shipped_calibration, shipped_prices
from cnca.jobs.accuracy.case_records import CaseRecord, NoiseRecord, TimeRecord
from cnca.jobs.accuracy.fidelity import (
    Pixels,
    squared_bias,
    squared_error,
    squared_noise,
    vehicle_pixels,
)
from cnca.scene.cameras import View, orbit_view
from cnca.scene.schema import Scene
from cnca.scene.weather import Fog, Weather

MODELS = [(effect, model) for effect in EFFECTS.values() for model in effect.priced]
"""What is priced."""
SIZE, LARGE = 64, 192
"""Pixels per side of the pictures that are compared, and of the larger ones of the noise."""
SAMPLES = 256
"""Rays per pixel of each of their halves."""
NOISE_SAMPLES = (4, 16, 64)
"""Rays per pixel at which noise is measured, fewest first."""
LEAST_ERROR = 1e-5
"""Stands for an error of exactly 0, which has no logarithm: pictures that are the same."""
VEHICLES = ("sedan", "hatchback", "suv", "van", "pickup")


@dataclass(frozen=True)
class Case:
    """One picture of one random scene."""

    scene: Scene
    albedo: torch.Tensor
    view: View
    weather: Weather


def random_case(seed: int) -> Case:
    """Vehicle, paint, ground, camera and weather at random; two of five in fog, one in dusk.

    In one of four the windows are clear.
    """
    rng = np.random.default_rng(seed)
    vehicle: dict[str, object] = {"mesh": f"builtin:{rng.choice(VEHICLES)}", "texture_size": 64}
    ground = {"color": [float(rng.uniform(0.2, 0.8))] * 3}
    altitude = rng.uniform(-8, 0) if rng.random() < 0.2 else rng.uniform(3, 80)
    fog = Fog(
        visibility=float(np.exp(rng.uniform(np.log(30), np.log(60_000)))),
        height=float(rng.uniform(3, 100)),
        albedo=float(rng.uniform(0.9, 1.0)),
    )
    weather = Weather(
        float(altitude),
        float(rng.uniform(0, 360)),
        float(rng.uniform(2, 8)),
        fog=fog if rng.random() < 0.4 else None,
    )
    azimuth, elevation, distance = rng.uniform([0, 3, 5], [360, 35, 15])
    view = orbit_view(
        float(azimuth),
        float(elevation),
        float(distance),
        fov=float(np.degrees(2 * np.arctan(3 / distance))),
        width=SIZE,
        height=SIZE,
    )
    blocks = rng.choice([1, 8])
    paint = rng.uniform(0.02, 0.9, (3, blocks, blocks)) ** rng.uniform(0.5, 2.5)
    albedo = torch.from_numpy(paint).float().repeat_interleave(64 // blocks, 1)
    albedo = albedo.repeat_interleave(64 // blocks, 2).contiguous()
    if rng.random() < 0.25:
        vehicle["glass_transmission"] = float(rng.uniform(0.2, 0.9))
    return Case(Scene.model_validate({"vehicle": vehicle, "ground": ground}), albedo, view, weather)


class Studio:
    """Renders one case with the models that are asked for."""

    def __init__(self, case: Case) -> None:
        self.renderer = build.build_renderer(case.scene, build.build_vehicle(case.scene))
        self.look(case)

    def look(self, case: Case) -> None:
        """Go on with another view of the same scene."""
        self.case = case
        self.mask = self.renderer.vehicle_mask([case.view])[0] == 1

    def plan(self, demand: Demand) -> EffectPlan:
        """The plan that meets the demand in this case."""
        case = self.case
        return self.renderer.plan(
            LinearTexture(case.albedo), [case.view], case.weather, demand=demand
        )

    @torch.no_grad()
    def picture(self, demand: Demand, seed: int) -> Pixels:
        """Pixels of the vehicle."""
        case = self.case
        image = self.renderer.render(
            LinearTexture(case.albedo), [case.view], case.weather, seed=seed, demand=demand
        )
        return vehicle_pixels(image, self.mask)

    def halves(self, demand: Demand) -> tuple[tuple[Pixels, Pixels], float]:
        """Two independent pictures, and the second one's processor seconds per million rays."""
        first = self.picture(demand, seed=1)
        started = time.process_time()
        second = self.picture(demand, seed=2)
        seconds = time.process_time() - started
        rays = self.case.view.width * self.case.view.height * self.plan(demand).samples
        return (first, second), seconds / rays * 1e6


def demand(samples: int, **forced: Model) -> Demand:
    """The reference's models but for those named."""
    return Demand(reference=True, forced={"samples": samples, **forced})


def measure(case: Case, only: str | None = None) -> CaseRecord:
    """Errors, noise and processor seconds of all models that the case can tell apart.

    With the name of an effect, the errors of its models alone.
    """
    studio = Studio(case)
    full = demand(SAMPLES)
    best = studio.plan(full)
    reference, seconds = studio.halves(full)
    timed = [TimeRecord(dict(best.models), seconds)]
    errors, known = {}, {}
    for effect, model in models_of(only):
        lower = demand(SAMPLES, **{effect.name: model})
        if studio.plan(lower)[effect.name] == best[effect.name]:
            continue
        pictures, seconds = studio.halves(lower)
        bias, uncertainty = squared_bias(pictures, reference)
        # What noise hides counts as large as the noise.
        errors[effect.key(model)] = float(max(bias, uncertainty) ** 0.5)
        known[effect.key(model)] = effect.share(model, best.subject)
        timed.append(TimeRecord(dict(studio.plan(lower).models), seconds))
    return CaseRecord(
        features=best.subject.features(),
        known=known,
        errors=errors,
        noise=measure_noise(studio) if only is None else [],
        timed=timed if only is None else [],
    )


def models_of(only: str | None) -> list[tuple[Effect, Model]]:
    """What is priced, of all effects or of one; raises CncaError for one without prices."""
    priced = sorted({effect.name for effect, _ in MODELS})
    if only is not None and only not in priced:
        hint = did_you_mean(only, priced)
        raise CncaError(f"--only {only}: effects with prices are {', '.join(priced)}{hint}")
    return [(effect, model) for effect, model in MODELS if only in (None, effect.name)]


def measure_noise(studio: Studio) -> list[NoiseRecord]:
    """Noise of small and large pictures with few and many rays per pixel."""
    rows, case = [], studio.case
    for size in (SIZE, LARGE):
        studio.look(replace(case, view=replace(case.view, width=size, height=size)))
        subject = studio.plan(demand(1)).subject
        pictures = {samples: studio.halves(demand(samples))[0] for samples in NOISE_SAMPLES}
        for samples, pair in pictures.items():
            # The picture of most rays tells which pixels are dark.
            noise = squared_noise(pair, pictures[NOISE_SAMPLES[-1]]) ** 0.5
            rows.append(NoiseRecord(subject.noise_features(samples), noise))
    studio.look(case)
    return rows


def fit_prices(records: Sequence[CaseRecord], only: str | None = None) -> Prices:
    """Prices that explain what :func:`measure` found in many cases.

    Of one effect alone, they stand beside all others of the list that ships.
    """
    errors = {}
    for effect, model in models_of(only):
        key = effect.key(model)
        known = [r for r in records if key in r.errors]
        if not known:
            raise RunError(f"{len(records)} scenes: none of them shows {key}; take more scenes")
        values = [max(r.errors[key], LEAST_ERROR) / r.known[key] for r in known]
        errors[key] = fit([r.features for r in known], values)
    if only is not None:
        shipped = shipped_prices()
        return replace(shipped, errors={**shipped.errors, **errors})
    rows = [row for record in records for row in record.noise]
    noise = fit([row.features for row in rows], [row.noise for row in rows])
    return Prices(errors, noise, _fit_seconds(records))


def _fit_seconds(records: Sequence[CaseRecord]) -> dict[str, float]:
    """Seconds of the models that are not the cheapest, none of them negative."""
    parts = [part for effect in EFFECTS.values() for part in effect.parts]
    rows, seconds = [], []
    for timed in (timed for record in records for timed in record.timed):
        work: dict[str, float] = {}
        for name, model in timed.models.items():
            work |= EFFECTS[name].work(model)
        rows.append([work.get(part, 0.0) for part in parts])
        seconds.append(timed.seconds)
    solution, _ = nnls(np.array(rows), np.array(seconds))
    return {part: round(float(s), 5) for part, s in zip(parts, solution, strict=True)}


def calibrate(
    out: Path, *, scenes: int, seed: int, console: Console, only: str | None = None
) -> Path:
    """Measure random cases, write ``out/prices.json`` and return its path.

    ``only`` names an effect whose prices are measured beside the shipped ones of the others.
    Cases that ``out`` holds already are not measured again.
    """
    models_of(only)  # a wrong name is refused before anything is written
    RunFolder(out, "calibrate").claim({"seed": seed, "only": only}, {}, resume=True)
    records = []
    with bar(console) as progress:
        for index in progress.track(range(scenes), description="scenes"):
            path = out / f"case_{seed}_{index}.json"
            if not path.exists():
                write_json(path, as_json(measure(random_case(seed + index), only)))
            records.append(read_record(CaseRecord, path, advice="delete it"))
    made = f"cnca calibrate --scenes {scenes} --seed {seed}"
    if only is not None:
        made = f"{shipped_calibration().made_by}; {made} --only {only}"
    prices = fit_prices(records, only)
    calibration = Calibration(made, (SIZE, LARGE), (SAMPLES, SAMPLES), versions(), prices)
    write_json(out / "prices.json", as_json(calibration))
    return out / "prices.json"


def obtained_error(case: Case, target: float, samples: int = 4 * SAMPLES) -> tuple[float, float]:
    """Error of the picture that a target error leads to, and its standard error."""
    studio = Studio(case)
    reference, _ = studio.halves(demand(samples))
    # Another seed than the reference's: the noise must be independent.
    wanted = replace(Demand(), target_error=target)
    square, uncertainty = squared_error(studio.picture(wanted, seed=3), reference)
    error = max(square, 0.0) ** 0.5
    return error, uncertainty / (2 * max(error, uncertainty**0.5))
