"""Pictures of a scene as it stands in its file: tone-mapped PNG or layered OpenEXR."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from cnca import build
from cnca.core.color import linear_to_srgb
from cnca.core.images import write_exr
from cnca.core.manifest import hashes, versions, write_json
from cnca.core.pictures import as_pictures, write_png
from cnca.core.records import as_json
from cnca.core.types import LinearImages
from cnca.effects.catalog import parse_effects
from cnca.effects.effect import Model
from cnca.effects.explain import Explanation, explain
from cnca.effects.plan import Demand, EffectPlan
from cnca.effects.protocols import PlanningRenderer
from cnca.jobs.accuracy.targets import MeasuredError, Scenery, meet
from cnca.jobs.render_request import RenderRequest
from cnca.scene.cameras import View
from cnca.scene.load_scene import load_scene
from cnca.scene.views import choose_views


@dataclass(frozen=True)
class RenderSeconds:
    """Wall-clock seconds of one picture."""

    first: float
    """Of the first call, which makes kernels, sky and fog."""
    steady: float
    """Of a second one; the same where the picture was made for a target."""


@dataclass(frozen=True)
class RenderRecord:
    """What stands beside a picture as JSON."""

    picture: str
    """The file's name."""
    view: View
    seed: int
    samples: int
    """Rays per pixel."""
    plan: list[Explanation]
    """Predicted errors; for a target, that of the rays and the whole are measured."""
    measured: MeasuredError | None
    """Where the picture was made for a target error or for seconds."""
    seconds: RenderSeconds
    vehicle_box_xyxy: tuple[float, float, float, float]
    """In pixels."""
    versions: dict[str, str]
    inputs: dict[str, str]
    """File that was read → SHA-256."""


def render_scene(request: RenderRequest) -> list[RenderRecord]:
    """Render views of a scene file and write each with a JSON record beside it.

    Returns:
        The records, one per view.
    """
    out, texture, seed = request.out, request.texture, request.seed
    demand = _demand(request)  # first, since a misspelled name is refused at once
    scene = load_scene(request.scene)
    views = choose_views(scene, request.view, every=request.all_views)
    vehicle = build.build_vehicle(scene)
    painted = build.build_paint(scene, vehicle).apply(
        build.read_texture(texture) if texture else None
    )
    renderer = build.build_renderer(scene, vehicle, demand=demand)
    forced = demand.forced
    inputs = hashes([*build.scene_files(scene, request.scene), *([texture] if texture else [])])
    records = []
    for view in views:
        path = out.with_name(f"{out.stem}_{view.name}{out.suffix}") if request.all_views else out
        left, top, right, bottom = renderer.vehicle_boxes([view])[0].tolist()
        picture = _picture(request, Scenery(renderer, painted, view, scene.weather(), forced))
        _write(path, picture.images, renderer, view)
        seconds = picture.seconds
        if picture.measured is None:  # a second time, now that the user has the picture
            steady = _picture(request, picture.scenery).seconds.first
            seconds = RenderSeconds(seconds.first, steady)
        record = RenderRecord(
            picture=path.name,
            view=view,
            seed=seed,
            samples=picture.plan.samples,
            plan=_explained(picture),
            measured=picture.measured,
            seconds=seconds,
            vehicle_box_xyxy=(left, top, right, bottom),
            versions=versions(),
            inputs=inputs,
        )
        write_json(path.with_suffix(".json"), as_json(record))
        records.append(record)
    return records


def _demand(request: RenderRequest) -> Demand:
    """Which effects to render how; raises CncaError for an effect or model that does not exist."""
    forced: dict[str, Model] = {"gradient": "off"}
    if request.samples is not None:
        forced["samples"] = request.samples
    return Demand(request.target_error, request.reference, forced | parse_effects(request.effects))


@dataclass(frozen=True)
class _Picture:
    images: LinearImages
    scenery: Scenery
    plan: EffectPlan
    seconds: RenderSeconds
    measured: MeasuredError | None = None


@torch.no_grad()
def _picture(request: RenderRequest, scenery: Scenery) -> _Picture:
    """A picture as it was asked for; a first call makes kernels, sky and fog."""
    renderer, albedo = scenery.renderer, scenery.albedo
    views, weather = [scenery.view], scenery.weather
    measured, started = None, time.perf_counter()
    if request.measures:
        target, seconds = request.target_error, request.target_seconds
        images, plan, measured = meet(scenery, target=target, seconds=seconds, seed=request.seed)
    else:
        images = renderer.render(albedo, views, weather, seed=request.seed)
        plan = renderer.plan(albedo, views, weather)
    spent = round(time.perf_counter() - started, 4)
    return _Picture(images, scenery, plan, RenderSeconds(spent, spent), measured)


def _explained(picture: _Picture) -> list[Explanation]:
    """The plan, with what was measured in place of what was predicted."""
    rows, measured = explain(picture.plan), picture.measured
    if measured is None:
        return rows
    target = picture.plan.demand.target_error
    why = f"measured: bias of the models at most {measured.bias:.2%}, noise {measured.noise:.2%}"
    if target is not None:
        why += f", {'under' if measured.error <= target else 'OVER'} the target of {target:.2%}"
    errors = {"samples": measured.noise, "all": measured.error}
    rows = [replace(row, error=round(errors.get(row.effect, row.error), 6)) for row in rows]
    return [*rows[:-1], replace(rows[-1], why=why)]


def _write(path: Path, images: LinearImages, renderer: PlanningRenderer, view: View) -> None:
    if path.suffix.lower() == ".png":
        write_png(path, as_pictures(linear_to_srgb(images))[0])
        return
    layers = renderer.layers([view])
    write_exr(
        path,
        {
            "": images[0].permute(1, 2, 0).numpy(),
            "mask": layers.mask[0],
            "depth": layers.depth[0],
            "uv": np.concatenate([layers.uv[0], np.zeros_like(layers.uv[0][..., :1])], axis=-1),
            "normal": layers.normal[0],
            "albedo": layers.albedo[0],
        },
    )
