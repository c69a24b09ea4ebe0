"""Prices of the models: what each costs in error and time, measured on random scenes.

In each scene every model below the reference's is rendered in its place, all else as in the
reference, both with the same random numbers; their difference is the model's error.  Effects that
most scenes lack have scenes of their own (:data:`cnca.jobs.accuracy.random_cases.SHOWING`).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
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
from cnca.effects.plan import Demand, EffectPlan, predicted_seconds
from cnca.effects.prices import Calibration, Prices, fit, shipped_calibration, shipped_prices
from cnca.effects.world import GEOMETRY
from cnca.jobs.accuracy.case_records import CaseRecord, NoiseRecord, TimeRecord
from cnca.jobs.accuracy.fidelity import (
    Pixels,
    squared_bias,
    squared_error,
    squared_noise,
    vehicle_pixels,
)
from cnca.jobs.accuracy.random_cases import SHOWING, SIZE, Case, random_case
from cnca.mi_bridge.portions import vehicle_part

MODELS = [(effect, model) for effect in EFFECTS.values() for model in effect.priced]
"""What is priced."""
LARGE = 192
"""Pixels per side of the larger pictures of the noise."""
SAMPLES = 256
"""Rays per pixel of each of their halves."""
NOISE_SAMPLES = (4, 16, 64)
"""Rays per pixel at which noise is measured, fewest first."""
LEAST_ERROR = 1e-5
"""Stands for an error of exactly 0, which has no logarithm: pictures that are the same."""
AMONG_HOUSES = ("surroundings", "lamps")
"""Effects of a world, priced by the vehicle's pixels alone, as a loop renders them."""
LEAST_PIXELS = 50
"""Of the vehicle; with fewer, too much of it is hidden for the case to tell anything."""


class Studio:
    """Renders one case with the models that are asked for."""

    def __init__(self, case: Case, *, vehicle_only: bool = False) -> None:
        """``vehicle_only`` renders its pixels alone, in which a world may be simplified."""
        self.renderer = build.build_path_tracer(case.scene, build.build_vehicle(case.scene))
        self.vehicle_only = vehicle_only
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
        what = LinearTexture(case.albedo), [case.view], case.weather
        if not self.vehicle_only:
            return vehicle_pixels(self.renderer.render(*what, seed=seed, demand=demand), self.mask)
        pixels = np.flatnonzero(self.mask)
        portion = vehicle_part(np.ones(len(pixels)))
        light = self.renderer.render_pixels(
            *what, pixels, seed=seed, demand=demand, portion=portion
        )
        return light.numpy().astype(np.float64)

    def halves(self, demand: Demand) -> tuple[tuple[Pixels, Pixels], float]:
        """Two independent pictures, and the second one's processor seconds per million rays."""
        first = self.picture(demand, seed=1)
        started = time.process_time()
        second = self.picture(demand, seed=2)
        seconds = time.process_time() - started
        rays = self.mask.sum() if self.vehicle_only else self.mask.size
        return (first, second), seconds / (float(rays) * self.plan(demand).samples) * 1e6


def demand(samples: int, **forced: Model) -> Demand:
    """The reference's models but for those named."""
    return Demand(reference=True, forced={"samples": samples, "surroundings": GEOMETRY, **forced})


def measure(case: Case, only: str | None = None) -> CaseRecord:
    """Errors, noise and processor seconds of all models that the case can tell apart.

    With the name of an effect, only the errors of its models.
    """
    studio = Studio(case, vehicle_only=only in AMONG_HOUSES)
    full = demand(SAMPLES)
    best = studio.plan(full)
    if studio.mask.sum() < LEAST_PIXELS:
        return CaseRecord(best.subject.features(), {}, {}, [], [])
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
    if only in SHOWING and all(EFFECTS[str(only)].work(t.models[str(only)]) for t in timed):
        timed.append(_without(studio, str(only)))
    return CaseRecord(
        features=best.subject.features(),
        known=known,
        errors=errors,
        noise=measure_noise(studio) if only is None else [],
        timed=timed if only is None or only in SHOWING else [],
    )


def _without(studio: Studio, effect: str) -> TimeRecord:
    """The time of the same picture without the effect, or with a model that takes none."""
    full = demand(SAMPLES)
    if effect == "surroundings":
        scene = studio.case.scene.model_copy(update={"world": None})
        studio = Studio(replace(studio.case, scene=scene), vehicle_only=True)
    else:
        free = [m for m in EFFECTS[effect].models if not EFFECTS[effect].work(m)]
        full = demand(SAMPLES, **{effect: free[-1]})
    return TimeRecord(dict(studio.plan(full).models), studio.halves(full)[1])


def models_of(only: str | None) -> list[tuple[Effect, Model]]:
    """What is priced, of one effect or of all that plain scenes show.

    Raises CncaError for an effect without prices.
    """
    if only is None:
        return [(effect, model) for effect, model in MODELS if effect.name not in SHOWING]
    priced = sorted({effect.name for effect, _ in MODELS} | set(SHOWING))
    if only not in priced:
        hint = did_you_mean(only, priced)
        raise CncaError(f"--only {only}: effects with prices are {', '.join(priced)}{hint}")
    return [(effect, model) for effect, model in MODELS if effect.name == only]


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


def fit_prices(
    records: Sequence[CaseRecord], only: str | None = None, beside: Prices | None = None
) -> Prices:
    """Prices that explain what :func:`measure` found in many cases.

    Args:
        only: whose prices they are; by default of all effects that plain scenes show.
        beside: those of all others, where they are of one effect; by default what ships.
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
        beside = beside or shipped_prices()
        seconds = _extra_seconds(EFFECTS[only], records, beside)
        return replace(
            beside, errors={**beside.errors, **errors}, seconds={**beside.seconds, **seconds}
        )
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


def _extra_seconds(
    effect: Effect, records: Sequence[CaseRecord], prices: Prices
) -> dict[str, float]:
    """Median seconds that the effect adds, on the machine whose seconds ``prices`` has."""
    extra: dict[str, list[float]] = {}
    for record in records:
        free = [t for t in record.timed if not effect.work(t.models[effect.name])]
        for timed in record.timed:
            for part in effect.work(timed.models[effect.name]) if free else {}:
                here = predicted_seconds(free[-1].models, prices) / free[-1].seconds
                extra.setdefault(part, []).append(here * (timed.seconds - free[-1].seconds))
    return {part: round(max(float(np.median(s)), 0.0), 5) for part, s in extra.items()}


def calibrate(
    out: Path, *, scenes: int, seed: int, console: Console, only: str | None = None
) -> Path:
    """Measure random cases, write ``out/prices.json`` and return its path.

    ``only`` names an effect whose prices are measured beside the shipped ones of the others.
    Cases that ``out`` holds already are not measured again.
    """
    models_of(only)  # a wrong name is refused before anything is written
    RunFolder(out, "calibrate").claim({"seed": seed, "only": only}, {}, resume=True)
    prices = shipped_prices()
    for effect in [only] if only else [None, *SHOWING]:
        records = []
        with bar(console) as progress:
            for index in progress.track(range(scenes), description=effect or "scenes"):
                name = f"case_{effect}" if effect in SHOWING else "case"
                path = out / f"{name}_{seed}_{index}.json"
                if not path.exists():
                    case = random_case(seed + index, effect, out)
                    write_json(path, as_json(measure(case, effect)))
                records.append(read_record(CaseRecord, path, advice="delete it"))
        prices = fit_prices(records, effect, prices)
    made = f"cnca calibrate --scenes {scenes} --seed {seed}"
    if only is not None:
        made = f"{shipped_calibration().made_by}; {made} --only {only}"
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
