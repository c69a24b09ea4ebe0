"""What an attack that has not ended shows of itself: its texture and pictures of a late step."""

from __future__ import annotations

import time
from pathlib import Path

from cnca.core.images import write_texture_srgb
from cnca.core.pictures import as_pictures, side_by_side, write_png
from cnca.core.types import SrgbImages, SrgbTexture

TEXTURE_NOW, VIEWS_NOW = "texture_now.png", "views_now.png"
COLUMNS = 4
"""Of the views in one row."""
SHARE = 0.01
"""Of an attack's time that may go into what it shows."""


class Display:
    """Writes into the run's folder, as often as :data:`SHARE` allows."""

    def __init__(self, out: Path) -> None:
        self.out = out
        self._due = 0.0

    def show(self, texture: SrgbTexture, pictures: SrgbImages) -> None:
        """Write both, unless the last time was too recent."""
        began = time.monotonic()
        if began < self._due:
            return
        write_texture_srgb(self.out / TEXTURE_NOW, texture.permute(1, 2, 0).cpu().numpy())
        write_png(self.out / VIEWS_NOW, side_by_side(as_pictures(pictures), columns=COLUMNS))
        self._due = began + (time.monotonic() - began) / SHARE

    def remove(self) -> None:
        """Take both away again: the run's result takes their place."""
        for name in (TEXTURE_NOW, VIEWS_NOW):
            (self.out / name).unlink(missing_ok=True)
