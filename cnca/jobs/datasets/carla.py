"""``cnca import-carla``: CARLA frames as a labelled data set, and how well the mesh fits them.

CARLA stores where the vehicle was dropped from, not how far it came down on its springs: each
frame's vertical offset is fitted to the photograph, and the outline that results is drawn over it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from rich.console import Console

from cnca import build
from cnca.core.errors import RunError, SceneError
from cnca.core.manifest import hashes
from cnca.core.pictures import TRUTH, SrgbPicture, write_png
from cnca.core.progress import bar
from cnca.core.run_folder import RunFolder
from cnca.jobs.datasets.coco import Mask
from cnca.jobs.datasets.layout import DataSet
from cnca.judge.records import OutlineDistance
from cnca.scene.cameras import View
from cnca.scene.carla import CarlaFrame, carla_view, read_carla_frame
from cnca.scene.load_scene import load_scene
from cnca.vehicle.model import Vehicle
from cnca.vehicle.outline import fit_lift, outline_distances, photographed_silhouette, silhouette

MOST_PIXELS = 3.0
"""Median distance between drawn and photographed outline from which a frame is left out."""


@dataclass(frozen=True)
class Fit:
    """The vehicle's mesh laid over one photograph."""

    lift: float
    """Metres; see :func:`cnca.scene.carla.carla_view`."""
    outline: OutlineDistance
    view: View
    mask: Mask


@dataclass(frozen=True)
class Transforms:
    """Location (m) and rotation (degrees) as CARLA gives them, 2 × 3."""

    vehicle: Sequence[Sequence[float]]
    camera: Sequence[Sequence[float]]


@dataclass(frozen=True)
class FrameRecord:
    """What the data set says of one frame."""

    source: str
    caption: str
    lift: float
    """Metres; see :func:`cnca.scene.carla.carla_view`."""
    outline_pixels: OutlineDistance
    view: View
    carla: Transforms


@dataclass(frozen=True)
class FrameProblem:
    """Why a frame is not in the data set."""

    source: str
    problem: str


def import_carla(
    folder: Path, out: Path, scene_file: Path, *, fov: float = 90.0, console: Console
) -> list[FrameRecord | FrameProblem]:
    """Make the data set ``out`` of all ``.npz`` frames in ``folder``; see :mod:`.layout`.

    Beside the layout's files, ``outlines/000000.png`` shows the outline on the photograph.

    Args:
        scene_file: a scene with the vehicle of the frames.
        fov: horizontal field of view of the camera in degrees.

    Returns:
        One record for each frame.

    Raises:
        RunError: there is no frame in ``folder``, or none that the vehicle meets, or ``out`` holds
            a data set of other frames.
        SceneError: a file is no frame.
    """
    sources = sorted(folder.glob("*.npz"))
    if not sources:
        raise RunError(f"{folder}: no .npz frames in this folder; give the one that holds them")
    scene = load_scene(scene_file)
    request = {"folder": folder, "scene": scene_file, "fov": fov}
    inputs = hashes([*build.scene_files(scene, scene_file), *sources])
    RunFolder(out, "import-carla").claim(request, inputs, resume=True)
    vehicle, data = build.build_vehicle(scene), DataSet(out, scene.vehicle.label)
    records: list[FrameRecord | FrameProblem] = []
    with bar(console) as shown:
        for index, source in enumerate(shown.track(sources, description="frames")):
            frame = read_carla_frame(source)
            try:
                fit = fit_frame(vehicle, frame, fov=fov, name=source.stem)
            except SceneError as error:
                records.append(FrameProblem(source.name, str(error)))
                continue
            picture = np.rint(frame.image * 255).astype(np.uint8)
            write_png(data.path("outlines", index), draw_outline(picture, fit.mask))
            if fit.outline.median > MOST_PIXELS:
                records.append(FrameProblem(source.name, _hopeless(frame, fit)))
                continue
            records.append(_record(source.name, frame, fit))
            data.add(index, picture, fit.mask, records[-1])
    data.finish(tar=False)
    problems = [record for record in records if isinstance(record, FrameProblem)]
    if len(problems) == len(records):
        first = problems[0]
        raise RunError(f"{folder}: the vehicle meets no frame; {first.source}: {first.problem}")
    return records


def _hopeless(frame: CarlaFrame, fit: Fit) -> str:
    """Why a frame is left out whose outline meets nothing."""
    cause = "check the field of view, and that cam_trans is relative to the vehicle's location"
    if np.abs(frame.camera[1]).max() <= 2 * np.pi:
        cause = "the camera's angles look like radians; CARLA's are degrees"
    return f"the outline lies {fit.outline.median:.1f} px from the photograph's; {cause}"


def fit_frame(vehicle: Vehicle, frame: CarlaFrame, *, fov: float, name: str) -> Fit:
    """The vertical offset at which the mesh meets the photograph best.

    The fit begins twice, from CARLA's location on the ground and above it by its height in the
    world; the better end counts.  Raises SceneError where the vehicle is in neither place.
    """
    fits, problem = [], None
    for start in {0.0, -float(frame.vehicle[0, 2])}:
        try:
            fits.append(_fit_from(start, vehicle, frame, fov, name))
        except SceneError as error:
            problem = error
    if not fits:
        assert problem is not None
        raise problem
    return min(fits, key=lambda fit: fit.outline.median)


def draw_outline(picture: SrgbPicture, mask: Mask) -> SrgbPicture:
    """A copy of the photograph with the mask's outline in green."""
    covered = (mask > 0).astype(np.uint8)
    contours, _ = cv2.findContours(covered, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return cv2.drawContours(picture.copy(), contours, -1, TRUTH, 1)


def _fit_from(start: float, vehicle: Vehicle, frame: CarlaFrame, fov: float, name: str) -> Fit:
    height, width = frame.image.shape[:2]

    def view(lift: float) -> View:
        size = {"width": width, "height": height, "fov": fov}
        return carla_view(frame.vehicle, frame.camera, lift=lift, name=name, **size)

    lift = start + fit_lift(vehicle, view(start), frame.image)
    fitted = view(lift)
    drawn = silhouette(vehicle, fitted)
    distances = outline_distances(drawn, photographed_silhouette(drawn, frame.image))
    median, high = (float(np.percentile(distances, p)) for p in (50, 90))
    return Fit(lift, OutlineDistance(median, high), fitted, drawn.astype(float))


def _record(source: str, frame: CarlaFrame, fit: Fit) -> FrameRecord:
    return FrameRecord(
        source=source,
        caption=f"{fit.view.name}: {fit.outline.median:.1f} px",
        lift=round(fit.lift, 3),
        outline_pixels=fit.outline.rounded(),
        view=fit.view,
        carla=Transforms(frame.vehicle.tolist(), frame.camera.tolist()),
    )
