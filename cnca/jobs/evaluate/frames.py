"""Textures drawn onto the vehicle in real frames, at the frames' own poses.

As in the paper (equations 1 and 2, section 3.1) a picture is I_out = B + X_ren with the background
B = I_in · (1 − M); here M is the share of each pixel that our mesh covers, once it is fitted to the
photograph, and the sums are of linear radiance.  X_ren is lit by the scene file's sun and sky, with
its exposure: nothing of the light is estimated from the photograph, and the shadow on the road is
the photographed one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from cnca.core.color import srgb_to_linear
from cnca.core.errors import RunError, SceneError
from cnca.core.types import Boxes, LinearImages, LinearTexture, SrgbImages
from cnca.effects.protocols import PlanningRenderer
from cnca.jobs.datasets.carla import MOST_PIXELS, fit_frame
from cnca.judge.evaluate import Shots
from cnca.judge.gallery import Arrays, digest, recall
from cnca.judge.records import FrameFit, OutlineDistance
from cnca.scene.cameras import View
from cnca.scene.carla import CarlaFrame, carla_view, read_carla_frame
from cnca.scene.weather import Weather
from cnca.vehicle.model import Vehicle


class OverFrames:
    """Renders the vehicle over photographs; a :class:`cnca.scene.protocols.Renderer`."""

    def __init__(self, renderer: PlanningRenderer, photographs: Mapping[View, SrgbImages]) -> None:
        """``photographs`` holds one image, (1, 3, height, width), for each view."""
        self.renderer, self._photographs = renderer, photographs

    def render(
        self, albedo: LinearTexture, views: Sequence[View], weather: Weather, *, seed: int
    ) -> LinearImages:
        """B + X_ren in linear radiance, (views, 3, height, width)."""
        rendered = self.renderer.render(albedo, views, weather, seed=seed)
        mask = torch.from_numpy(self.renderer.vehicle_mask(views)).to(rendered)[:, None]
        photographed = srgb_to_linear(
            SrgbImages(torch.cat([self._photographs[view] for view in views]))
        )
        return LinearImages(torch.lerp(photographed, rendered, mask))

    def vehicle_boxes(self, views: Sequence[View]) -> Boxes:
        """Bounding boxes (views, 4) of the fitted vehicle, xyxy in pixels."""
        return self.renderer.vehicle_boxes(views)


@dataclass(frozen=True)
class Frames:
    """Frames that the vehicle's mesh meets, as the shots of a stage: one frame to each weather."""

    name: str
    """Of their folder."""
    shots: Shots
    photographs: dict[View, SrgbImages]
    fits: Sequence[FrameFit]
    """Of every frame in the folder, used or not."""

    def photograph(self, weather: int) -> SrgbImages:
        """The untouched frame of this number."""
        return self.photographs[self.shots.views[weather][0]]


def read_frames(
    folder: Path, vehicle: Vehicle, weather: Weather, *, fov: float, kept: Path, seed: int
) -> Frames:
    """Read all ``.npz`` frames of a folder and fit the vehicle to each of them.

    Args:
        weather: what lights the vehicle.
        fov: horizontal field of view of the frames in degrees.
        kept: folder for the fits, which take seconds each.

    Raises:
        RunError: there is no frame, or the vehicle meets none.
        SceneError: a file is no frame.
    """
    sources = sorted(folder.glob("*.npz"))
    if not sources:
        raise RunError(f"{folder}: no .npz frames in this folder; give the one that holds them")
    fits, photographs = [], {}
    for source in sources:
        frame = read_carla_frame(source)
        fit = _fit(source.stem, vehicle, frame, fov, kept / f"{source.stem}.npz")
        fits.append(fit)
        if fit.used and fit.lift is not None:
            height, width = frame.image.shape[:2]
            view = carla_view(
                frame.vehicle,
                frame.camera,
                lift=fit.lift,
                width=width,
                height=height,
                fov=fov,
                name=source.stem,
            )
            image = torch.from_numpy(frame.image).permute(2, 0, 1)[None].contiguous()
            photographs[view] = SrgbImages(image)
    if not photographs:
        first = fits[0]
        apart = first.outline_pixels.median if first.outline_pixels else None
        problem = first.problem or f"its outline lies {apart} pixels off"
        raise RunError(f"{folder}: the scene's vehicle meets no frame; the first: {problem}")
    shots = Shots([[view] for view in photographs], [weather] * len(photographs), seed)
    return Frames(folder.resolve().name, shots, photographs, fits)


def _fit(name: str, vehicle: Vehicle, frame: CarlaFrame, fov: float, kept: Path) -> FrameFit:
    meshes = [array for part in vehicle.parts for array in (part.vertices, part.faces)]
    key = digest(frame.image, frame.vehicle, frame.camera, fov, *meshes)

    def fit() -> Arrays:
        best = fit_frame(vehicle, frame, fov=fov, name=name)
        outline = best.outline
        return {"numbers": np.array([best.lift, outline.median, outline.percentile_90])}

    try:
        lift, median, high = recall(kept, key, fit)["numbers"].tolist()
    except SceneError as error:
        return FrameFit(name, used=False, problem=str(error))
    return FrameFit(
        name,
        used=median <= MOST_PIXELS,
        lift=round(lift, 4),
        outline_pixels=OutlineDistance(median, high).rounded(),
    )
