"""``cnca gallery``: the scenes that ship, or those of a folder, as a list and as one sheet."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from rich.console import Console

from cnca import build
from cnca.core.color import linear_to_srgb
from cnca.core.errors import CncaError, RunError
from cnca.core.pictures import SrgbPicture, as_pictures, side_by_side, write_png
from cnca.core.progress import bar
from cnca.scene import shipped
from cnca.scene.load_scene import load_scene
from cnca.scene.schema import Scene
from cnca.scene.views import build_views

COLUMNS, SAMPLES = 3, 64
"""Pictures per row, rays per pixel."""
LEAST, MOST = 96, 8192
"""Pixels per row that a sheet may have."""


@dataclass(frozen=True)
class Entry:
    """One scene file; without a ``scene`` the ``problem`` says why."""

    name: str
    scene: Scene | None
    problem: str = ""

    def weather(self) -> str:
        """Sun and fog in a few words."""
        if self.scene is None:
            return ""
        sun = self.scene.sun
        text = f"sun {sun.altitude:g}°" if sun.scale > 0 else "no sun"
        fog = self.scene.fog
        return text + (f", fog {fog.visibility:g} m" if fog else "")


def entries(folder: Path | None) -> list[Entry]:
    """The scene files of a folder; None is the shipped ones, by their ``builtin:`` names.

    Raises RunError for a folder without scene files.
    """
    files = sorted((folder or shipped.FOLDER).glob("*.yaml"))
    if not files:
        raise RunError(f"{folder or shipped.FOLDER}: no scene files (.yaml) in it")
    listed = []
    for file in files:
        name = str(file) if folder else shipped.PREFIX + file.stem
        try:
            listed.append(Entry(name, load_scene(file)))
        except CncaError as error:
            listed.append(Entry(name, None, str(error)))
    return listed


def write_sheet(
    listed: list[Entry], out: Path, console: Console, *, width: int, captions: bool = True
) -> dict[str, str]:
    """Render each scene's first camera into one PNG of ``width`` pixels per row.

    Without ``captions`` no names are written into it; the places are in the order of ``listed``.
    Returns name → problem of scenes that could not be rendered, such as one whose mesh is missing;
    their places stay dark.
    """
    if out.suffix.lower() != ".png":
        raise RunError(f"{out}: the sheet is written as PNG; end the name with .png")
    if not LEAST <= width <= MOST:
        raise RunError(f"--width {width}: give {LEAST} to {MOST} pixels")
    side = width // min(COLUMNS, len(listed))
    pictures, problems = [], {}
    with bar(console) as shown:
        for entry in shown.track(listed, description="scenes"):
            try:
                pictures.append(_picture(entry, side))
            except CncaError as error:
                problems[entry.name] = str(error)
                pictures.append(np.full((side, side, 3), 40, np.uint8))
    names = [entry.name for entry in listed] if captions else []
    write_png(out, side_by_side(pictures, names, columns=COLUMNS, width=width))
    return problems


@torch.no_grad()
def _picture(entry: Entry, side: int) -> SrgbPicture:
    """A square of ``side`` pixels."""
    if entry.scene is None:
        raise RunError(entry.problem)
    image = entry.scene.image
    shrink = side / max(image.width, image.height)
    size = {
        "width": max(1, round(image.width * shrink)),
        "height": max(1, round(image.height * shrink)),
    }
    scene = entry.scene.model_copy(update={"image": image.model_copy(update=size)})
    vehicle = build.build_vehicle(scene)
    albedo = build.build_paint(scene, vehicle).apply()
    renderer = build.build_renderer(scene, vehicle, samples=SAMPLES)
    view = build_views(scene)[0]
    images = renderer.render(albedo, [view], scene.weather(), seed=0)
    picture = as_pictures(linear_to_srgb(images))[0]
    canvas = np.zeros((side, side, 3), np.uint8)
    top, left = ((side - extent) // 2 for extent in picture.shape[:2])
    canvas[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
    return canvas
