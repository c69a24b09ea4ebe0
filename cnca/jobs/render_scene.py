"""Pictures of a scene as it stands in its file: tone-mapped PNG or layered OpenEXR."""

from __future__ import annotations

import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from cnca import build
from cnca.core.color import linear_to_srgb
from cnca.core.errors import RunError
from cnca.core.images import write_exr
from cnca.core.manifest import hashes, versions, write_json
from cnca.core.pictures import as_pictures, write_png
from cnca.core.types import LinearImages, LinearTexture
from cnca.effects.effect import Model
from cnca.effects.explain import explain
from cnca.effects.plan import Demand
from cnca.effects.protocols import PlanningRenderer
from cnca.scene.cameras import View
from cnca.scene.schema import Scene, load_scene

FORMATS = (".png", ".exr")


def render_scene(
    scene_file: Path,
    out: Path,
    *,
    view: str | None = None,
    all_views: bool = False,
    samples: int | None = None,
    demand: Demand | None = None,
    texture: Path | None = None,
    seed: int = 0,
) -> list[dict[str, Any]]:
    """Render views of a scene file and write each with a JSON record beside it.

    Args:
        out: ``.png`` or ``.exr``; with ``all_views`` each view's name is put before the ending.
        view: name of the view; by default the first.
        samples: rays per pixel; by default the scene's, or what a target error takes.
        demand: which effects to render how; by default the usual ones.
        texture: sRGB picture for the paint; by default the scene's own paint.

    Returns:
        The records, one per view: view, seed, plan, seconds (first call and steady), bounding box
        (xyxy in pixels), versions, and SHA-256 of all files that were read.
    """
    if out.suffix.lower() not in FORMATS:
        raise RunError(f"{out}: pictures are written as {' or '.join(FORMATS)}; change the ending")
    if samples is not None and samples < 1:
        raise RunError(f"--spp {samples}: a picture needs at least one ray per pixel")
    scene = load_scene(scene_file)
    views = build.choose_views(scene, view, every=all_views)
    vehicle = build.build_vehicle(scene)
    painted = build.build_paint(scene, vehicle).apply(
        build.read_texture(texture) if texture else None
    )
    demand = demand or Demand()
    named: dict[str, Model] = {"samples": samples} if samples else {}
    demand = replace(demand, forced={"gradient": "off", **named, **demand.forced})
    renderer = build.build_renderer(scene, vehicle, demand=demand)
    inputs = hashes([*build.scene_files(scene, scene_file), *([texture] if texture else [])])
    records = []
    for each in views:
        path = out.with_name(f"{out.stem}_{each.name}{out.suffix}") if all_views else out
        box = renderer.vehicle_boxes([each])[0].tolist()
        images, first = _timed(renderer, painted, each, scene, seed)
        _write(path, images, renderer, each)
        _, steady = _timed(renderer, painted, each, scene, seed)  # after the user has the picture
        plan = renderer.plan(painted, [each], scene.weather())
        record = {
            "picture": path.name,
            "view": asdict(each),
            "seed": seed,
            "samples": plan.samples,
            "plan": [asdict(row) for row in explain(plan)],
            "seconds": {"first": first, "steady": steady},
            "vehicle_box_xyxy": box,
            "versions": versions(),
            "inputs": inputs,
        }
        write_json(path.with_suffix(".json"), record)
        records.append(record)
    return records


@torch.no_grad()
def _timed(
    renderer: PlanningRenderer, albedo: torch.Tensor, view: View, scene: Scene, seed: int
) -> tuple[LinearImages, float]:
    """The picture and its seconds; a first call makes kernels, sky and fog."""
    started = time.perf_counter()
    images = renderer.render(LinearTexture(albedo), [view], scene.weather(), seed=seed)
    return images, round(time.perf_counter() - started, 4)


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
