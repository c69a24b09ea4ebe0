"""The surfaces of the built-in worlds by name: pictures are painted once for each process."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Float, UInt8

from cnca.scene.materials import MATERIALS, LinearRgb
from cnca.world.builtin.glazing_pictures import (
    lit_rooms,
    lit_shop_windows,
    rooms,
    shop_names,
    shop_windows,
    traffic_signs,
)
from cnca.world.builtin.ground_pictures import (
    asphalt,
    bark,
    grass,
    gravel,
    kerb,
    leaves,
    road_paint,
    setts,
    slabs,
    soil,
)
from cnca.world.builtin.lamps import WARM, colored
from cnca.world.builtin.wall_pictures import (
    ashlar,
    brick,
    concrete,
    plaster,
    roof_felt,
    roof_tiles,
    wood,
)
from cnca.world.model import Surface

Picture = Float[np.ndarray, "height width 3"]


@dataclass(frozen=True)
class Finish:
    """A surface without its picture, and how to paint that."""

    picture: Callable[[], Picture] | None = None
    tile: tuple[float, float] = (1.0, 1.0)
    """Width and height of the picture in metres; (1, 1) leaves texture coordinates as they are."""
    tint: LinearRgb = (1.0, 1.0, 1.0)
    roughness: float = 0.85
    specular: float = 0.4
    metallic: float = 0.0
    clearcoat: float = 0.0
    soaks: bool = False
    emission: LinearRgb = (0.0, 0.0, 0.0)
    """Radiance while lamps are on, W/m²/nm/sr."""
    glow: Callable[[], Picture] | None = None
    """Picture of what emits, a factor on it."""

    def surface(self) -> Surface:
        """The surface with its picture."""
        return Surface(
            base_color=self.tint,
            texture=None if self.picture is None else _painted(self.picture),
            roughness=self.roughness,
            specular=self.specular,
            metallic=self.metallic,
            clearcoat=self.clearcoat,
            soaks=self.soaks,
            emission=self.emission,
            glow=None if self.glow is None else _painted(self.glow),
        )


@cache
def _painted(picture: Callable[[], Picture]) -> UInt8[np.ndarray, "height width 3"]:
    """The picture in sRGB (IEC 61966-2-1), read-only since all worlds share it."""
    linear = np.clip(picture(), 0.0, 1.0)
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    texture = np.round(255 * srgb).astype(np.uint8)
    texture.flags.writeable = False
    return texture


def _plain(color: LinearRgb, roughness: float = 0.6, metallic: float = 0.0) -> Finish:
    return Finish(tint=color, roughness=roughness, metallic=metallic)


_LANE = (13.0, 13.0)
_PLASTERS: tuple[LinearRgb, ...] = (
    (0.58, 0.54, 0.45),
    (0.52, 0.44, 0.30),
    (0.44, 0.31, 0.21),
    (0.46, 0.47, 0.46),
    (0.62, 0.60, 0.56),
    (0.36, 0.41, 0.36),
    (0.50, 0.36, 0.28),
    (0.34, 0.39, 0.44),
)
_DOORS: tuple[LinearRgb, ...] = (
    (0.10, 0.05, 0.03),
    (0.03, 0.07, 0.05),
    (0.05, 0.07, 0.13),
    (0.22, 0.20, 0.18),
)
PAINTS: dict[str, tuple[float, LinearRgb]] = {
    "white": (0.24, (0.68, 0.68, 0.67)),
    "black": (0.18, (0.012, 0.012, 0.013)),
    "anthracite": (0.14, (0.050, 0.052, 0.056)),
    "grey": (0.12, (0.17, 0.175, 0.18)),
    "silver": (0.10, (0.42, 0.43, 0.44)),
    "blue": (0.08, (0.022, 0.055, 0.19)),
    "red": (0.06, (0.30, 0.018, 0.018)),
    "sky_blue": (0.02, (0.10, 0.20, 0.32)),
    "green": (0.02, (0.03, 0.09, 0.05)),
    "beige": (0.02, (0.36, 0.31, 0.23)),
    "orange": (0.02, (0.45, 0.14, 0.02)),
}
"""Paint of traffic → its share among new cars in Europe (rounded), its linear reflectance."""


def _library() -> dict[str, Finish]:
    finishes = {
        "asphalt": Finish(asphalt, _LANE, roughness=0.88),
        "asphalt_new": Finish(asphalt, _LANE, (0.62, 0.62, 0.64), roughness=0.85),
        "asphalt_old": Finish(asphalt, _LANE, (1.28, 1.26, 1.22), roughness=0.92),
        "tar": _plain((0.022, 0.022, 0.023), 0.55),
        "iron": _plain((0.075, 0.070, 0.066), 0.5, metallic=0.3),
        "marking": Finish(road_paint, (2.0, 2.0), roughness=0.7),
        "marking_yellow": Finish(road_paint, (2.0, 2.0), (1.0, 0.72, 0.14), roughness=0.7),
        "slabs": Finish(slabs, (4.8, 4.8)),
        "setts": Finish(setts, (1.6, 1.6), roughness=0.75),
        "kerb": Finish(kerb, (1.0, 1.0)),
        "grass": Finish(grass, (4.0, 4.0), specular=0.2, roughness=1.0, soaks=True),
        "field": Finish(
            grass, (4.0, 4.0), (1.9, 1.35, 1.6), specular=0.2, roughness=1.0, soaks=True
        ),
        "soil": Finish(soil, (2.0, 2.0), roughness=1.0, specular=0.2, soaks=True),
        "gravel": Finish(gravel, (2.0, 2.0), roughness=0.95, soaks=True),
        "leaves": Finish(leaves, (1.0, 1.0), roughness=0.6, specular=0.3),
        "leaves_dark": Finish(leaves, (1.0, 1.0), (0.62, 0.70, 0.75), roughness=0.6),
        "leaves_light": Finish(leaves, (1.0, 1.0), (1.35, 1.2, 0.9), roughness=0.6),
        "shade": Finish(leaves, (1.0, 1.0), (0.30, 0.34, 0.34), roughness=1.0, specular=0.1),
        "bark": Finish(bark, (1.0, 1.0), roughness=0.95, specular=0.2),
        "brick": Finish(brick, (2.0, 1.8)),
        "brick_brown": Finish(brick, (2.0, 1.8), (0.72, 0.95, 1.0)),
        "brick_yellow": Finish(brick, (2.0, 1.8), (1.35, 2.35, 2.35)),
        "ashlar": Finish(ashlar, (2.4, 2.4)),
        "ashlar_grey": Finish(ashlar, (2.4, 2.4), (0.72, 0.80, 0.98)),
        "concrete": Finish(concrete, (3.0, 3.0)),
        "roof_tiles": Finish(roof_tiles, (2.0, 2.0)),
        "roof_slate": Finish(roof_tiles, (2.0, 2.0), (0.36, 0.76, 1.2), roughness=0.6),
        "roof_felt": Finish(roof_felt, (2.0, 2.0)),
        "timber": Finish(wood, (0.96, 0.96), (0.30, 0.19, 0.11)),
        "pane": Finish(
            rooms, roughness=0.05, specular=0.7, emission=colored(15.0, WARM), glow=lit_rooms
        ),
        "display": Finish(
            shop_windows,
            roughness=0.05,
            specular=0.6,
            emission=colored(80.0, WARM),
            glow=lit_shop_windows,
        ),
        "shop_name": Finish(shop_names, roughness=0.5),
        "sign": Finish(traffic_signs, roughness=0.4),
        "frame_white": _plain((0.62, 0.61, 0.58), 0.5),
        "frame_dark": _plain((0.055, 0.055, 0.058), 0.45),
        "frame_brown": _plain((0.11, 0.06, 0.035), 0.5),
        "stone": _plain((0.42, 0.39, 0.34), 0.85),
        "steel": _plain((0.33, 0.34, 0.35), 0.45, metallic=0.5),
        "steel_dark": _plain((0.035, 0.040, 0.042), 0.45),
        "zinc": _plain((0.22, 0.23, 0.24), 0.45, metallic=0.5),
        "awning_red": _plain((0.26, 0.03, 0.03), 0.8),
        "awning_green": _plain((0.03, 0.10, 0.06), 0.8),
        "awning_cream": _plain((0.50, 0.45, 0.34), 0.8),
        "bin": _plain((0.03, 0.055, 0.04), 0.5),
        "lamp_glass": _plain((0.70, 0.70, 0.66), 0.25),
        "lamp_red": _plain((0.20, 0.01, 0.01), 0.25),
        "lamp_amber": _plain((0.24, 0.11, 0.01), 0.25),
        "lamp_green": _plain((0.01, 0.16, 0.08), 0.25),
    }
    finishes |= {
        f"plaster_{i}": Finish(plaster, (4.0, 4.0), tint) for i, tint in enumerate(_PLASTERS)
    }
    finishes |= {f"door_{i}": _plain(color, 0.4) for i, color in enumerate(_DOORS)}
    return finishes | _traffic()


def _traffic() -> dict[str, Finish]:
    """What built-in vehicles are made of; lights have names of their own for the night."""
    names = {"light": "lamp_headlight", "tail_light": "lamp_tail"}
    finishes = {}
    for name, material in MATERIALS.items():
        finish = Finish(
            tint=material.base_color,
            roughness=material.roughness,
            specular=material.specular,
            metallic=material.metallic,
            clearcoat=material.clearcoat,
        )
        finishes[names.get(name, f"car_{name}")] = finish
    coat = MATERIALS["paint"]
    for name, (_, color) in PAINTS.items():
        finishes[f"paint_{name}"] = Finish(
            tint=color, roughness=coat.roughness, specular=coat.specular, clearcoat=coat.clearcoat
        )
    return finishes


FINISHES = _library()
"""Every surface that a built-in world may use."""
PLASTERS = tuple(f"plaster_{i}" for i in range(len(_PLASTERS)))
DOORS = tuple(f"door_{i}" for i in range(len(_DOORS)))
