"""``cnca reorder-uv``: a mesh with a new UV layout, its textures, and what that gained."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
import yaml
from jaxtyping import Bool

from cnca import build
from cnca.core.color import linear_to_srgb
from cnca.core.errors import MeshError, RunError
from cnca.core.images import SrgbArray, read_mask, read_texture_srgb, write_texture_srgb
from cnca.core.manifest import write_json
from cnca.core.pictures import SrgbPicture, as_pictures, side_by_side, write_png
from cnca.core.records import as_json
from cnca.core.types import SrgbTexture
from cnca.jobs.vehicle.source import Source
from cnca.scene.cameras import orbit_view
from cnca.scene.load_scene import load_scene, vehicle_section
from cnca.scene.paint import Paint
from cnca.scene.schema import Scene
from cnca.vehicle.mesh.checkup import SCENE_ENDINGS
from cnca.vehicle.mesh.write_mesh import write_obj
from cnca.vehicle.model import Vehicle
from cnca.vehicle.uv.layout import Layout, measure
from cnca.vehicle.uv.masks import paint_mask
from cnca.vehicle.uv.rebake import rebake, shown_in
from cnca.vehicle.uv.reorder import reorder
from cnca.vehicle.uv.skin import Skin

SQUARE = 0.12
"""Metres on the car that a square of the checker measures."""
SHOWN, TEXELS = 384, 1024
"""Pixels per side of each picture, and of the texture that it shows."""
OVERLAPPING = 0.05
"""Share of doubly used texture from which a layout cannot carry one paint."""


@dataclass(frozen=True)
class Reordering:
    """What a new layout gained, measured on the painted faces that can be seen from outside."""

    mesh: str
    was: str
    """Whose the layout before was."""
    before: Layout
    after: Layout
    vehicle: Mapping[str, str]
    """The ``vehicle`` section of a scene that reads the new mesh."""


def reorder_uv(source: Source, out: Path, *, size: int = 2048, samples: int = 32) -> Reordering:
    """Write ``out`` (OBJ), its textures, a report (.json) and a picture (.png) beside it.

    The OBJ is in our axes: scenes read it with ``up: z``.  Mask and base texture of ``source`` are
    carried over to ``…_mask.png`` and ``…_base.png`` of ``size``² texels.

    Raises:
        MeshError: the mesh cannot be read, or cannot be written under that name.
        TextureError: a texture cannot be read.
        RunError: ``size`` is too small.
    """
    if size < 64:
        raise RunError(f"--size {size}: textures have at least 64 texels per side")
    if out.suffix.lower() != ".obj":
        raise MeshError(f"{out}: vehicles are written as OBJ; end the name with .obj")
    scene = _scene(source)
    given = scene.vehicle
    mask = read_mask(scene.base / given.paint_mask) if given.paint_mask else None
    vehicle, was = _load(scene)
    old = Skin.of(vehicle)
    result = reorder(vehicle, None if mask is None else shown_in(mask, old.corners))
    new = Skin.of(result.vehicle)
    section = {"mesh": out.name, "up": "z"}
    textures = {}
    if mask is not None:
        textures["paint_mask"] = np.repeat(_float(mask)[..., None], 3, axis=2)
    if given.base_texture:
        textures["base_texture"] = read_texture_srgb(scene.base / given.base_texture)
    for key, texture in textures.items():
        path = out.with_name(f"{out.stem}_{'mask' if key == 'paint_mask' else 'base'}.png")
        write_texture_srgb(path, rebake(texture, old.corners, new.corners, size).clip(0, 1))
        section[key] = path.name
    write_obj(out, result.vehicle)
    before, after = (measure(skin, result.outside) for skin in (old, new))
    report = Reordering(source.mesh, was, before, after, section)
    write_json(out.with_suffix(".json"), as_json(report))
    baked = None if mask is None else rebake(_float(mask), old.corners, new.corners, size) > 0.5
    pictures = _pictures(vehicle, mask, samples) + _pictures(result.vehicle, baked, samples)
    captions = ("layout before", "checker before", " ", "layout after", "checker after", " ")
    sheet = side_by_side(pictures, captions, columns=3)
    write_png(out.with_suffix(".png"), sheet)
    return report


def _scene(source: Source) -> Scene:
    """A scene with the vehicle; raises MeshError for materials that are no mapping."""
    if Path(source.mesh).suffix in SCENE_ENDINGS:
        return load_scene(source.mesh)
    try:
        materials = yaml.safe_load(source.materials) if source.materials else {}
    except yaml.YAMLError:
        materials = None
    if not isinstance(materials, dict):
        raise MeshError(f"materials '{source.materials}': write them as '{{NAME: paint}}'")
    named = {"paint_mask": source.paint_mask, "base_texture": source.base_texture}
    section = vehicle_section(
        {
            "mesh": source.mesh,
            "up": source.up,
            "front": source.front,
            "scale": source.scale,
            "materials": {str(name): str(kind) for name, kind in materials.items()},
            **{key: str(path) for key, path in named.items() if path},
        }
    )
    return Scene(vehicle=section)


def _load(scene: Scene) -> tuple[Vehicle, str]:
    """The vehicle with its own layout where it has a usable one, else with xatlas' own.

    Where pictures are drawn on the file's own layout, no other one will do.
    """
    section = scene.vehicle
    drawn = bool(section.paint_mask or section.base_texture)
    anew = Scene(vehicle=section.model_copy(update={"unwrap": True}), base=scene.base)
    try:
        vehicle = build.build_vehicle(scene)
    except MeshError as error:
        if "texture coordinates" not in str(error) or drawn:
            raise
        return build.build_vehicle(anew), "xatlas (file: no usable UVs)"
    skin = Skin.of(vehicle)
    if drawn or section.unwrap:
        return vehicle, "xatlas" if section.unwrap else "the file's own"
    if measure(skin, np.ones(len(skin.faces), bool)).overlap > OVERLAPPING:
        return build.build_vehicle(anew), "xatlas (file: UVs overlap)"
    return vehicle, "the file's own"


def _float(mask: Bool[np.ndarray, "height width"]) -> np.ndarray:
    return mask.astype(np.float32)


def checkerboard(size: int, squares: int) -> SrgbArray:
    """``squares``² squares whose hue tells the place: left to right, and paler upwards."""
    row, column = np.mgrid[:size, :size] / size
    hue, paleness = 179 * column, 255 * (0.4 + 0.6 * row)
    hsv = np.stack([hue, paleness, np.full_like(hue, 255)], axis=2).astype(np.uint8)
    colors = cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB) / np.float32(255)
    dark = (np.floor(row * squares) + np.floor(column * squares)) % 2
    return colors * (1 - 0.75 * dark[..., None]).astype(np.float32)


def _pictures(
    vehicle: Vehicle, mask: Bool[np.ndarray, "height width"] | None, samples: int
) -> list[SrgbPicture]:
    """The layout filled with a checker, and the car in it from two sides."""
    skin = Skin.of(vehicle)
    checker = checkerboard(TEXELS, max(2, round(skin.metres_per_unit / SQUARE)))
    painted = paint_mask(vehicle, TEXELS)
    if mask is not None:
        painted &= cv2.resize(mask.astype(np.uint8), (TEXELS, TEXELS), interpolation=0) > 0
    flat = cv2.resize(np.where(painted[..., None], checker, 0.1), (SHOWN, SHOWN), interpolation=3)
    paint = Paint(
        SrgbTexture(torch.full((3, TEXELS, TEXELS), 0.2)), torch.from_numpy(painted[None]).float()
    )
    albedo = paint.apply(SrgbTexture(torch.from_numpy(checker).permute(2, 0, 1)))
    scene = Scene.model_validate({"vehicle": {"texture_size": TEXELS}})
    views = [
        orbit_view(azimuth, 25, 6.5, fov=50, width=SHOWN, height=SHOWN, name=str(azimuth))
        for azimuth in (40, 220)
    ]
    renderer = build.build_renderer(scene, vehicle, samples=samples)
    with torch.no_grad():
        images = renderer.render(albedo, views, scene.weather(), seed=0)
    return [np.rint(flat.clip(0, 1) * 255).astype(np.uint8), *as_pictures(linear_to_srgb(images))]
