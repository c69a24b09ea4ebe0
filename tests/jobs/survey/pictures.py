"""Surveys of flat pictures."""

from pathlib import Path

import numpy as np

from cnca.core.pictures import write_png

SOURCES = {"Normal": (180, 20, 20), "FCA": (20, 160, 20), "CNCA": (20, 20, 180)}
VIEWS = ("front", "left")


def draw_sources(folder: Path) -> Path:
    """A folder with one folder for each source, and in it a picture for each view."""
    for source, color in SOURCES.items():
        for brightness, view in enumerate(VIEWS):
            picture = np.full((60, 90, 3), np.array(color) + 30 * brightness, np.uint8)
            write_png(folder / source / f"{view}.png", picture)
    return folder
