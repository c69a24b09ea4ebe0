"""A world as Mitsuba's shapes: one mesh for each surface, so that few BSDFs are compiled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float, UInt8

from cnca.core.color import decode
from cnca.mi_bridge.variant import mi
from cnca.mi_bridge.wet import FILM, wet_principled
from cnca.scene.materials import LinearRgb
from cnca.world.model import Piece, Surface, World

LINEAR = decode(torch.arange(256, dtype=torch.float64) / 255).numpy()
"""8-bit sRGB → linear."""


def world_shapes(world: World, *, lit: bool = False, wetness: float = 0.0) -> dict[str, mi.Mesh]:
    """Name of a surface → its mesh, with its own BSDF.

    Args:
        lit: whether what glows does so.
        wetness: of all that looks up, in [0, 1].
    """
    by_surface: dict[str, list[Piece]] = {}
    for piece in world.pieces:
        if len(piece.faces):
            by_surface.setdefault(piece.surface, []).append(piece)
    return {
        name: _merged(
            name,
            pieces,
            surface_bsdf(world.surfaces[name], wetness),
            _glow(world.surfaces[name]) if lit else None,
        )
        for name, pieces in by_surface.items()
    }


def holed_surfaces(world: World) -> list[str]:
    """Names of those that light passes, such as the leaves of a tree."""
    used = {piece.surface for piece in world.pieces if len(piece.faces)}
    return sorted(name for name in used if world.surfaces[name].opacity is not None)


def surface_bsdf(surface: Surface, wetness: float = 0.0) -> mi.BSDF:
    """A principled BSDF with two sides: meshes of unknown origin have flipped faces."""
    principled: dict[str, object] = {
        "type": "principled",
        "base_color": _color(surface),
        "roughness": surface.roughness,
        "specular": surface.specular,
        "metallic": surface.metallic,
    }
    if surface.clearcoat > 0:
        principled |= {"clearcoat": surface.clearcoat, "clearcoat_gloss": 1.0}
    if wetness > 0 and _gets_wet(surface):
        principled = wet_principled(principled, wetness, film=not surface.soaks)
    bsdf = {"type": "twosided", "bsdf": principled}
    if surface.opacity is not None:
        share = surface.opacity[..., None].astype(np.float32) / 255
        bsdf = {"type": "mask", "opacity": linear_bitmap(share), "bsdf": bsdf}
    return mi.load_dict(bsdf)


def _gets_wet(surface: Surface) -> bool:
    """Ground does; leaves, metal, lacquer and glass stay as they are."""
    porous = surface.metallic < 0.5 and surface.clearcoat == 0 and surface.roughness > FILM
    return porous and surface.opacity is None


def _color(surface: Surface) -> dict[str, object]:
    if surface.texture is None:
        return {"type": "rgb", "value": [float(c) for c in surface.base_color]}
    # Made linear here, so that the factor is applied in linear light; 256 levels are a table.
    return linear_bitmap(_linear(surface.texture, surface.base_color))


def _linear(
    picture: UInt8[np.ndarray, "height width 3"], factor: LinearRgb
) -> Float[np.ndarray, "height width 3"]:
    linear = (LINEAR[:, None] * np.array(factor)).astype(np.float16)
    return np.stack([linear[picture[..., c], c] for c in range(3)], axis=-1)


def linear_bitmap(linear: Float[np.ndarray, "height width channels"]) -> dict[str, object]:
    """A repeated picture of linear values; half precision is finer than the 8 bits of its file."""
    bitmap = mi.Bitmap(np.ascontiguousarray(linear, dtype=np.float16))
    return {"type": "bitmap", "bitmap": bitmap, "raw": True, "format": "fp16"}


def _glow(surface: Surface) -> dict[str, object] | None:
    """What a surface emits as an emitter of Mitsuba."""
    if not surface.glows:
        return None
    if surface.glow is None:
        return area_light({"type": "rgb", "value": [float(c) for c in surface.emission]})
    # Half precision ends at 6e-8, about 4 mcd/m²: what is darker is black.
    return area_light(linear_bitmap(_linear(surface.glow, surface.emission)))


def area_light(radiance: dict[str, object]) -> dict[str, object]:
    """An emitter for the front of a mesh."""
    return {"type": "area", "radiance": radiance}


def _merged(
    name: str, pieces: Sequence[Piece], bsdf: mi.BSDF, glow: dict[str, object] | None
) -> mi.Mesh:
    starts = np.cumsum([0] + [len(piece.vertices) for piece in pieces])
    vertices = np.concatenate([piece.vertices for piece in pieces])
    normals = np.concatenate([piece.normals for piece in pieces])
    faces = np.concatenate([p.faces + s for p, s in zip(pieces, starts, strict=False)])
    uvs = [piece.uvs if piece.uvs is not None else piece.vertices[:, :2] for piece in pieces]
    textured = any(piece.uvs is not None for piece in pieces)
    return make_mesh(
        name, bsdf, vertices, faces, normals, np.concatenate(uvs) if textured else None, glow
    )


def make_mesh(
    name: str,
    bsdf: mi.BSDF,
    vertices: Float[np.ndarray, "vertices 3"],
    faces: np.ndarray,
    normals: Float[np.ndarray, "vertices 3"],
    uvs: Float[np.ndarray, "vertices 2"] | None,
    glow: dict[str, object] | None = None,
) -> mi.Mesh:
    """A triangle mesh from arrays; ``uvs`` have v upwards, Mitsuba's v runs down the picture.

    ``glow`` is the emitter of its front.
    """
    properties = mi.Properties()
    properties["bsdf"] = bsdf
    if glow is not None:
        properties["emitter"] = mi.load_dict(glow)
    mesh = mi.Mesh(
        name,
        vertex_count=len(vertices),
        face_count=len(faces),
        has_vertex_normals=True,
        has_vertex_texcoords=uvs is not None,
        props=properties,
    )
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = _flat(vertices)
    parameters["vertex_normals"] = _flat(normals)
    parameters["faces"] = mi.UInt32(np.ascontiguousarray(faces, dtype=np.uint32).ravel())
    if uvs is not None:
        parameters["vertex_texcoords"] = _flat(uvs * [1, -1] + [0, 1])
    parameters.update()
    return mesh


def _flat(values: np.ndarray) -> mi.Float:
    return mi.Float(np.ascontiguousarray(values, dtype=np.float32).ravel())
