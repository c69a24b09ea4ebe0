"""Wavefront MTL files: what an OBJ's materials look like.

Source: Wavefront, "Material Library File (.mtl)", version 4.2.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import trimesh
from PIL import Image

from cnca.core.text import decode_names

COLORS = {"kd": "diffuse", "ka": "ambient", "ks": "specular"}
NUMBERS = ("ns", "d", "tr")
"""Gloss exponent, opacity, and one minus it."""
OPTIONS = {
    "-blendu": 1, "-blendv": 1, "-boost": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1, "-mm": 2,
    "-o": 3, "-s": 3, "-t": 3, "-texres": 1, "-type": 1, "-bm": 1,
}  # fmt: skip
"""Options before a picture's name → the most values that follow them."""


def material_library(rest: str) -> list[str]:
    """The files that follow ``mtllib``: one with blanks in its name, or several."""
    return [rest] if rest.lower().count(".mtl") <= 1 else rest.split()


def materials_of(
    library: str, read: Callable[[str], bytes]
) -> dict[str, trimesh.visual.material.SimpleMaterial]:
    """The materials of a library by their names; none where it is missing."""
    try:
        text = decode_names(read(library))
    except OSError:
        return {}
    found: dict[str, dict[str, Any]] = {}
    values: dict[str, Any] = {}
    for line in text.split("\n"):
        key, _, rest = line.strip(" \t").replace("\t", " ").partition(" ")
        key, rest = key.lower(), rest.strip()
        if key == "newmtl":
            values = found.setdefault(rest, {})
        elif key == "map_kd":
            values["picture"] = picture_name(rest)
        elif key in (*COLORS, *NUMBERS):
            numbers = [n for n in map(_number, rest.split()) if n is not None]
            if key in COLORS and len(numbers) >= 3:
                values[COLORS[key]] = np.clip(numbers[:3], 0, 1)
            elif key in NUMBERS and numbers:
                values[key] = numbers[-1]
    return {name: made_material(values, read) for name, values in found.items()}


def pictures_of(text: str) -> list[str]:
    """The pictures of base colors that a library names."""
    lines = (line.strip().replace("\t", " ").partition(" ") for line in text.split("\n"))
    return [picture_name(rest) for key, _, rest in lines if key.lower() == "map_kd"]


def picture_name(rest: str) -> str:
    """A picture's name, which may hold blanks, after its options."""
    words = rest.split(" ")
    while words and (count := OPTIONS.get(words[0].lower())):
        words = _after_values(words[1:], count)
    return " ".join(words).strip().strip('"')


def _after_values(words: Sequence[str], count: int) -> list[str]:
    """What follows an option's values, up to ``count``; the first, of any kind, is always there."""
    left = list(words[1:])
    for _ in range(count - 1):
        if left and isinstance(_number(left[0]), float):
            left = left[1:]
    return left


def made_material(
    values: dict[str, Any], read: Callable[[str], bytes]
) -> trimesh.visual.material.SimpleMaterial:
    """A material with these values, and with the ``picture`` of this name where it is found."""
    name = values.pop("picture", None)
    material = trimesh.visual.material.SimpleMaterial(**values)
    if name:
        try:
            material.image = Image.open(io.BytesIO(read(name)))
            material.image.info["file_path"] = name
        except (OSError, ValueError, Image.DecompressionBombError):
            pass  # whoever looks for pictures says what is missing
    return material


def _number(word: str) -> float | None:
    try:
        return float(word)
    except ValueError:
        return None
