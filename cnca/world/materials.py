"""Materials of mesh files as surfaces of a world."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
import trimesh
from jaxtyping import Float, UInt8

from cnca.core.color import decode
from cnca.scene.materials import LinearRgb
from cnca.world.model import Surface

LARGEST = 4096
"""Texels per side of a picture; larger ones are scaled down."""
LEAST_HOLES = 0.01
"""Share of clear texels below which a picture's alpha is an exporter's leftover."""


def material_surface(mesh: trimesh.Trimesh) -> Surface:
    """How the mesh reflects light; grey where the file says nothing."""
    material = getattr(mesh.visual, "material", None)
    if isinstance(material, trimesh.visual.material.PBRMaterial):
        return _from_gltf(material)
    if isinstance(material, trimesh.visual.material.SimpleMaterial):
        return _from_mtl(material)
    colors = getattr(mesh.visual, "vertex_colors", None)
    if colors is not None and getattr(mesh.visual, "kind", None) == "vertex":
        return Surface(base_color=_linear(np.asarray(colors)[:, :3].mean(axis=0) / 255))
    return Surface()


def _from_gltf(material: Any) -> Surface:
    """glTF 2.0, section 3.9: factors are linear, the picture of the base color is sRGB."""
    factor = np.ones(4) if material.baseColorFactor is None else _unit(material.baseColorFactor)
    texture, opacity = _picture(material.baseColorTexture)
    if material.alphaMode not in ("MASK", "BLEND"):
        opacity = None
    elif opacity is None and factor[3] < 1:
        opacity = np.full((1, 1), round(255 * factor[3]), np.uint8)
    if opacity is not None and material.alphaMode == "MASK":
        cutoff = 0.5 if material.alphaCutoff is None else float(material.alphaCutoff)
        opacity = np.where(opacity >= 255 * cutoff, 255, 0).astype(np.uint8)
    return Surface(
        base_color=_rgb(factor[:3]),
        texture=texture,
        opacity=opacity,
        roughness=_or(material.roughnessFactor, 1.0),
        metallic=_or(material.metallicFactor, 1.0),
    )


def _from_mtl(material: Any) -> Surface:
    """Wavefront MTL; a picture stands for Kd, which exporters leave at 0.588 beside it."""
    values = {str(key).lower(): value for key, value in (material.kwargs or {}).items()}
    texture, opacity = _picture(material.image)
    solid = _number(values.get("d"), 1.0 - _number(values.get("tr"), 0.0))
    if opacity is None and 0 < solid < 1:
        opacity = np.full((1, 1), round(255 * solid), np.uint8)
    color = (1.0, 1.0, 1.0) if texture is not None else _linear(_unit(material.diffuse)[:3])
    exponent = max(_number(values.get("ns"), 10.0), 0.0)
    shiny = float(np.max(_unit(material.specular)[:3])) > 0
    return Surface(
        base_color=color,
        texture=texture,
        opacity=opacity,
        # Blinn-Phong's exponent as the width of a microfacet lobe, α² = 2 / (n + 2) (Walter et al.
        # 2007), and α the square of a principled roughness.
        roughness=float((2 / (exponent + 2)) ** 0.25),
        specular=0.5 if shiny else 0.0,
    )


def _picture(
    image: Any,
) -> tuple[UInt8[np.ndarray, "height width 3"] | None, UInt8[np.ndarray, "height width"] | None]:
    """The picture of a Pillow image, and its alpha where that is not solid."""
    if image is None:
        return None, None
    if max(image.size) > LARGEST:
        image = image.copy()
        image.thumbnail((LARGEST, LARGEST))
    pixels = np.asarray(image.convert("RGBA"), dtype=np.uint8)
    alpha = pixels[..., 3]
    holes = (alpha < 128).mean() > LEAST_HOLES
    return np.ascontiguousarray(pixels[..., :3]), alpha.copy() if holes else None


def _unit(values: Any) -> Float[np.ndarray, " channels"]:
    """A color in [0, 1]; trimesh keeps some as bytes."""
    values = np.asarray(values)
    return values / 255.0 if values.dtype == np.uint8 else np.clip(values.astype(float), 0, 1)


def _linear(srgb: Float[np.ndarray, "3"]) -> LinearRgb:
    return _rgb(decode(torch.from_numpy(np.asarray(srgb, np.float64))).numpy())


def _rgb(values: Float[np.ndarray, "3"]) -> LinearRgb:
    red, green, blue = (float(value) for value in values)
    return red, green, blue


def _or(value: Any, default: float) -> float:
    return default if value is None else float(np.clip(value, 0, 1))


def _number(value: Any, default: float) -> float:
    """A number of an MTL file, which trimesh keeps as words."""
    try:
        return float(np.ravel(value)[0]) if value is not None else default
    except (TypeError, ValueError):
        return default
