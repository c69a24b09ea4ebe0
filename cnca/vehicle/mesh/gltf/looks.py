"""The materials of a glTF: base colors, and where on their pictures the coordinates lie."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from cnca.vehicle.mesh.gltf.container import Entry

TRANSFORM = "KHR_texture_transform"
GLOSS = "KHR_materials_pbrSpecularGlossiness"


def base_texture(material: Entry) -> Entry:
    """What the file says of the picture of the base color; nothing where there is none."""
    return _metallic(material).get("baseColorTexture", {})


def uv_transform(texture: Entry) -> tuple[int, Float[np.ndarray, "2 3"]]:
    """The set of coordinates of a picture, and the affine map from these to it.

    Source: Khronos, KHR_texture_transform: scaled, then turned, then moved.
    """
    moved = texture.get("extensions", {}).get(TRANSFORM, {})
    number = moved.get("texCoord", texture.get("texCoord", 0))
    angle, scale = float(moved.get("rotation", 0.0)), moved.get("scale", (1.0, 1.0))
    c, s = np.cos(angle), np.sin(angle)
    turned = np.array([[c, -s], [s, c]]) * np.array(scale, float)
    return int(number), np.column_stack([turned, np.array(moved.get("offset", (0.0, 0.0)), float)])


def plain_materials(materials: Sequence[Entry]) -> list[Entry]:
    """All with a name, and with their pictures in the first set of coordinates."""
    return [_plain(material, number) for number, material in enumerate(materials)]


def _plain(material: Entry, number: int) -> Entry:
    look = dict(_metallic(material))
    if "baseColorTexture" in look:
        look["baseColorTexture"] = {"index": look["baseColorTexture"]["index"]}
    look.pop("metallicRoughnessTexture", None)
    plain = {"name": material.get("name") or f"material_{number}", "pbrMetallicRoughness": look}
    return plain | {key: material[key] for key in ("alphaMode", "alphaCutoff") if key in material}


def _metallic(material: Entry) -> Entry:
    """Metal and roughness, also of a material that says specular and glossiness instead."""
    gloss = material.get("extensions", {}).get(GLOSS)
    if gloss is None:
        return material.get("pbrMetallicRoughness", {})
    look = {"metallicFactor": 0.0, "roughnessFactor": 1 - float(gloss.get("glossinessFactor", 1))}
    renamed = {"baseColorTexture": "diffuseTexture", "baseColorFactor": "diffuseFactor"}
    return look | {new: gloss[old] for new, old in renamed.items() if old in gloss}
