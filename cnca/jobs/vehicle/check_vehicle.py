"""``cnca check-vehicle``: what stands between a mesh and an attack on it, with pictures."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
import yaml

from cnca import build
from cnca.core.color import linear_to_srgb, srgb_to_linear
from cnca.core.errors import MeshError, SceneError
from cnca.core.files import write_text
from cnca.core.manifest import write_json
from cnca.core.pictures import SrgbPicture, as_pictures, side_by_side, write_png
from cnca.core.records import as_json
from cnca.core.types import LinearImages, SrgbTexture
from cnca.core.yaml_text import read_yaml
from cnca.jobs.vehicle.reorder_uv import SQUARE, checkerboard
from cnca.scene.cameras import orbit_view
from cnca.scene.load_scene import load_scene, vehicle_section
from cnca.scene.schema import Scene, VehicleSection
from cnca.scene.shipped import scene_file
from cnca.vehicle.mesh.checkup import SCENE_ENDINGS, check, mended
from cnca.vehicle.mesh.finding import Finding
from cnca.vehicle.mesh.load_mesh import BUILTIN
from cnca.vehicle.mesh.pieces import as_made_of, paint_picture, read_pieces, sound
from cnca.vehicle.model import Vehicle
from cnca.vehicle.uv.skin import Skin
from cnca.vehicle.uv.uv_checkup import overlaps, skin_with_uvs

SHOWN, TEXELS = 448, 1024
"""Pixels per side of each picture, and texels per side of the checker."""
SAMPLES = 32
GREY, DOUBLED, EMPTY = 0.7, (0.9, 0.1, 0.1), (0.1, 0.1, 0.1)
EXAMPLE = "builtin:sedan_clear"
OWN_PICTURE = "base_texture.png"


@dataclass(frozen=True)
class Checkup:
    """What there is to say about a vehicle."""

    mesh: str
    usable: bool
    """Whether it can be attacked as it is."""
    findings: Sequence[Finding]
    """The worst first."""
    vehicle: Mapping[str, object]
    """The scene's ``vehicle`` section with the keys that mend what keys can mend."""

    def content(self) -> dict[str, Any]:
        """What ``vehicle.json`` holds: every finding as its line, too."""
        content = as_json(self)
        for plain, finding in zip(content["findings"], self.findings, strict=True):
            plain["line"] = finding.line()
        return content


def check_vehicle(mesh: str, out: Path | None, **given: object) -> Checkup:
    """Look at a mesh file, ``builtin:NAME`` or the vehicle of a scene file.

    Args:
        mesh: what to look at.
        out: folder for ``vehicle.json``, ``vehicle.png`` and ``scene.yaml``, a scene with the
            vehicle as mended, and else as the given or the shipped one; after an unwrap also for
            ``layout.png``, the new layout to draw a mask on.  None writes nothing.
        given: keys of the scene's vehicle section that stand above the scene's, such as ``up``.

    Raises:
        MeshError: the mesh cannot be read at all.
        SceneError: the scene file cannot be read.
    """
    scene = (
        load_scene(mesh)
        if mesh.endswith(SCENE_ENDINGS)
        else Scene(vehicle=VehicleSection(mesh=mesh))
    )
    section = vehicle_section(scene.vehicle.model_dump(exclude_unset=True) | given)
    findings = check(section, scene.base, mesh)
    proposed = mended(section, findings)
    keys = proposed.model_dump(exclude_unset=True, exclude_defaults=True)
    report = Checkup(
        mesh=section.mesh,
        usable=not any(finding.severity == "fault" for finding in findings),
        findings=findings,
        vehicle=keys | {"mesh": section.mesh},
    )
    if out is not None:
        report = _with_own_picture(report, proposed, scene.base, out)
        write_png(out / "vehicle.png", _sheet(section, proposed, scene.base, findings))
        write_json(out / "vehicle.json", report.content())
        if proposed.unwrap:
            _write_layout(out / "layout.png", proposed, scene.base)
        _write_scene(out, mesh if mesh.endswith(SCENE_ENDINGS) else EXAMPLE, report.vehicle)
    return report


def _write_scene(out: Path, example: str, vehicle: Mapping[str, object]) -> None:
    """The scene file ``example`` with another ``vehicle``, whose paths start at the example's."""
    file = scene_file(example)
    base = Path() if example == EXAMPLE else file.parent
    named = ("mesh", "paint_mask", "base_texture")
    paths = {key: str(vehicle[key]) for key in named if key in vehicle}
    moved = {
        key: Path(os.path.relpath(base / path, out)).as_posix()
        for key, path in paths.items()
        if not path.startswith(BUILTIN)
    }
    scene = read_yaml(file, SceneError)
    scene["vehicle"] = {**vehicle, **moved}
    text = yaml.safe_dump(scene, sort_keys=False, default_flow_style=None, allow_unicode=True)
    write_text(out / "scene.yaml", text)


def _sheet(
    section: VehicleSection, proposed: VehicleSection, base: Path, findings: Sequence[Finding]
) -> SrgbPicture:
    """The file's UV charts, and the vehicle as the proposed section shows it where it can."""
    pictures, captions = [_charts(section, base)], ["the file's UVs; red: used twice"]
    try:
        vehicle = build.build_vehicle(Scene(vehicle=proposed, base=base))
    except MeshError:
        return side_by_side(pictures, captions)
    as_proposed = " (as mended)" if any(finding.keys for finding in findings) else ""
    pictures += _views(vehicle)
    return side_by_side(pictures, [*captions, "shape" + as_proposed, "checker" + as_proposed])


def _with_own_picture(report: Checkup, proposed: VehicleSection, base: Path, out: Path) -> Checkup:
    """The file's own picture as base texture, where its UVs stay and it has none."""
    builtin = proposed.mesh.startswith(BUILTIN)
    if builtin or proposed.unwrap or proposed.base_texture:
        return report
    picture = paint_picture(as_made_of(sound(read_pieces(proposed, base)), proposed))
    if picture is None:
        return report
    write_png(out / OWN_PICTURE, np.asarray(picture, np.uint8))
    path = Path(os.path.relpath(out / OWN_PICTURE, base)).as_posix()
    return replace(report, vehicle={**report.vehicle, "base_texture": path})


def _write_layout(path: Path, proposed: VehicleSection, base: Path) -> None:
    """The new UVs as white triangles with dark edges on black."""
    try:
        corners = Skin.of(build.build_vehicle(Scene(vehicle=proposed, base=base))).corners
    except MeshError:
        return
    sheet = np.zeros((TEXELS, TEXELS, 3), np.uint8)
    fixed = np.rint((corners * (TEXELS, -TEXELS) + (-0.5, TEXELS - 0.5)) * 16).astype(np.int32)
    for triangle in fixed:
        cv2.fillConvexPoly(sheet, triangle, (255, 255, 255), shift=4)
    cv2.polylines(sheet, list(fixed), isClosed=True, color=(120, 120, 120), shift=4)
    write_png(path, sheet)


def _charts(section: VehicleSection, base: Path) -> SrgbPicture:
    """The texture that the file's own coordinates use, what is used more than once in red."""
    painted = [piece for piece in sound(read_pieces(section, base)) if piece.kind == "paint"]
    skin = skin_with_uvs(painted)
    sheet = np.full((TEXELS, TEXELS, 3), EMPTY, np.float32)
    if skin is not None:
        colors = 0.3 + 0.5 * _checker(skin).max(axis=2, keepdims=True)  # red stands for doubled
        used = np.zeros((TEXELS, TEXELS), np.uint8)
        corners = skin.corners * (TEXELS, -TEXELS) + (0, TEXELS)
        for triangle in np.rint(corners * 16).astype(np.int32):
            cv2.fillConvexPoly(used, triangle, 1, shift=4)
        sheet = np.where(used[..., None] > 0, colors, sheet)
        sheet[overlaps(skin, TEXELS)] = DOUBLED
    small = cv2.resize(sheet, (SHOWN, SHOWN), interpolation=cv2.INTER_AREA)
    return np.rint(small * 255).astype(np.uint8)


def _views(vehicle: Vehicle) -> list[SrgbPicture]:
    """From the front left, plain and in the checker; so far away that it fills the picture."""
    corners = np.concatenate([part.vertices for part in vehicle.parts])
    low, high = corners.min(axis=0), corners.max(axis=0)
    middle = (low + high) / 2
    view = orbit_view(
        40,
        25,
        1.4 * float((high - low).max()),
        fov=45,
        width=SHOWN,
        height=SHOWN,
        target=(float(middle[0]), float(middle[1]), float(middle[2])),
    )
    scene = Scene.model_validate({"vehicle": {"texture_size": TEXELS}})
    renderer = build.build_renderer(scene, vehicle, samples=SAMPLES)
    checker = SrgbTexture(torch.from_numpy(_checker(Skin.of(vehicle))).permute(2, 0, 1))
    textures = SrgbTexture(torch.full_like(checker, GREY)), checker
    with torch.no_grad():
        images = torch.cat(
            [renderer.render(srgb_to_linear(t), [view], scene.weather(), seed=0) for t in textures]
        )
    return as_pictures(linear_to_srgb(LinearImages(images)))


def _checker(skin: Skin) -> np.ndarray:
    """Squares of :data:`SQUARE` metres on the car, on average."""
    return checkerboard(TEXELS, int(np.clip(round(skin.metres_per_unit / SQUARE), 2, 64)))
