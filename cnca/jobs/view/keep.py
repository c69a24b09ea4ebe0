"""What the page saves: the scene as a file that renders the same, and the picture."""

from __future__ import annotations

from pathlib import Path

import yaml

from cnca.core.color import linear_to_srgb
from cnca.core.files import write_text
from cnca.core.pictures import SrgbPicture, as_pictures, write_png
from cnca.core.types import LinearImages, LinearTexture
from cnca.jobs.view.controls import scene_content, with_whole_paths
from cnca.scene.schema import Scene


def free_number(folder: Path) -> int:
    """The first that no file of the folder has at the end of its name."""
    stems = (path.stem.rpartition("_")[2] for path in folder.glob("*_*"))
    return max((int(stem) for stem in stems if stem.isdecimal()), default=0) + 1


def save_picture(folder: Path, picture: SrgbPicture) -> Path:
    """Write ``picture_N.png``."""
    path = folder / f"picture_{free_number(folder):03d}.png"
    write_png(path, picture)
    return path


def save_scene(folder: Path, scene: Scene, albedo: LinearTexture | None) -> Path:
    """Write ``scene_N.yaml``, and beside it the paint where it is not the scene's own.

    Raises RunError if the folder cannot be written.
    """
    number = free_number(folder)
    path = folder / f"scene_{number:03d}.yaml"
    content = with_whole_paths(scene_content(scene), scene.base)
    if albedo is not None:
        paint = folder / f"paint_{number:03d}.png"
        write_png(paint, as_pictures(linear_to_srgb(LinearImages(albedo[None])))[0])
        content.setdefault("vehicle", {})["base_texture"] = paint.name
    text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=100)
    write_text(path, f"# Saved by cnca view.\n{text}")
    return path
