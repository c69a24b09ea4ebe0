"""``cnca print-sheets``: a run's camouflage on paper, for a model of the vehicle.

Writes the PDF, and beside it ``….json`` and ``….md``: panels, colors, predicted attack strength.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import torch
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from pydantic import Field
from rich.console import Console
from scipy.ndimage import distance_transform_edt

from cnca import build
from cnca.core.errors import RunError, did_you_mean
from cnca.core.files import write_text
from cnca.core.images import SrgbArray, read_mask
from cnca.core.manifest import hashes, versions, write_json
from cnca.core.progress import bar
from cnca.core.records import as_json
from cnca.core.types import SrgbTexture
from cnca.jobs.printing.press import difference, load_press
from cnca.jobs.printing.printed_run import RUN_FILES, Prediction, predict, read_run
from cnca.jobs.printing.sheets import PAPERS, PIXEL, Artwork, lay_out, printed_area, write_pdf
from cnca.judge.records import Estimate
from cnca.scene.schema import Scene
from cnca.vehicle.uv.develop import Panel, develop
from cnca.vehicle.uv.rebake import face_of_texels, rebake, shown_in
from cnca.vehicle.uv.skin import Skin
from cnca.vehicle.uv.unfold import SIDES

BLEED = 3.0
"""Millimetres of color beyond the line to cut along."""
SEEN = 2.0
"""ΔE2000 from which a change of color is plain to see."""


@dataclass(frozen=True)
class PanelRow:
    """One panel on the sheets."""

    name: str
    width: float
    """Millimetres on paper, as is the height."""
    height: float
    stretch: float
    """Of lengths, at most in 95 % of the area."""
    mean_delta_e: float
    """ΔE2000 between the wanted and the printed color, mean over the area."""


@dataclass(frozen=True)
class SheetReport:
    """What is on the sheets, and what printing does to it."""

    run: str
    scale: str
    paper: str
    pages: int
    printer: str
    printed_share: float
    """Share of the painted outside that the panels hold."""
    panels: Sequence[PanelRow]
    color_change: Annotated[Mapping[str, float], Field(alias="colours")]
    """Statistic → ΔE2000 of the paint."""
    prediction: Prediction | None


def print_sheets(
    folder: Path,
    out: Path,
    *,
    scale: float = 12.0,
    paper: str = "A4",
    profile: Path | None = None,
    judged: bool = True,
    console: Console,
) -> SheetReport:
    """Write the sheets of a run's folder, and what printing does to its colors and strength.

    Args:
        folder: of a finished ``cnca optimize``.
        out: PDF to write.
        scale: of the model: 12 for 1:12.
        paper: one of :data:`cnca.jobs.printing.sheets.PAPERS`.
        profile: ICC profile of the printer; None is offset on coated paper.
        judged: whether to render the printed texture in the run's held-out views.

    Raises:
        RunError: no finished run, an unknown paper, a scale or file name that cannot be used.
    """
    _refuse(out, paper)
    run, press = read_run(folder), load_press(profile)
    wanted = run.texture.permute(1, 2, 0).numpy()
    printed = press(wanted)
    as_tensor = torch.from_numpy(printed).permute(2, 0, 1).contiguous()
    texture = torch.lerp(run.paint.base, as_tensor, run.paint.mask).permute(1, 2, 0).numpy()
    skin = Skin.of(run.vehicle)
    panels, share = develop(run.vehicle, _painted(run.scene, skin))
    with bar(console) as shown:
        drawn = shown.track(panels, description="panels")
        arts = [artwork(panel, skin, texture, scale) for panel in drawn]
        pages = lay_out(arts, printed_area(paper))
        task = shown.add_task("pages", total=len(pages) + 1)
        title = f"{folder.name}, {run.vehicle.name}, 1:{scale:g}"
        key = partial(_key, panels=panels, skin=skin, texture=texture)
        write_pdf(out, paper, pages, title, key, partial(shown.advance, task))
    inputs = [folder / name for name in RUN_FILES] + ([profile] if profile else [])
    inputs += build.scene_files(run.scene, run.request.scene)
    change = difference(wanted, printed)
    report = SheetReport(
        run=str(folder),
        scale=f"1:{scale:g}",
        paper=paper,
        pages=len(pages) + 1,
        printer=str(profile) if profile else "offset on coated paper (cnca.jobs.printing.press)",
        printed_share=round(share, 4),
        panels=[_panel_row(panel, skin, change, scale) for panel in panels],
        color_change=_color_change(change[run.paint.mask[0].numpy() > 0.5]),
        prediction=predict(run, SrgbTexture(as_tensor), console) if judged else None,
    )
    made_from = {"versions": versions(), "inputs": hashes(inputs)}
    write_json(out.with_suffix(".json"), as_json(report) | made_from)
    write_text(out.with_suffix(".md"), markdown(report))
    return report


def _refuse(out: Path, paper: str) -> None:
    """Raise RunError for a paper or a file name that cannot be used."""
    if paper not in PAPERS:
        hint = did_you_mean(paper, PAPERS)
        raise RunError(f"--paper {paper}: there are {', '.join(PAPERS)}{hint}")
    if out.suffix.lower() != ".pdf":
        raise RunError(f"{out}: sheets are written as PDF; end the name with .pdf")


def read_scale(text: str) -> float:
    """12 for "1:12"; raises RunError for anything else."""
    match = re.fullmatch(r"1:(\d+(?:\.\d+)?)", text)
    if not match or not float(match[1]) > 0:
        raise RunError(f"--scale {text}: write it as 1:12")
    return float(match[1])


def artwork(panel: Panel, skin: Skin, texture: SrgbArray, scale: float) -> Artwork:
    """The panel at 1:``scale`` with its bleed, as the texture paints it."""
    millimetres = panel.corners * 1000 / scale + BLEED
    width, height = (panel.size * 1000 / scale + 2 * BLEED).tolist()
    pixels = math.ceil(max(width, height) / PIXEL)
    corners = millimetres / (pixels * PIXEL)
    colors = rebake(texture, skin.corners[panel.faces], corners, pixels)
    covered = face_of_texels(corners, pixels) >= 0
    inked = distance_transform_edt(~covered) * PIXEL <= BLEED
    kept = slice(pixels - math.ceil(height / PIXEL), None), slice(math.ceil(width / PIXEL))
    picture = np.where(inked[..., None], colors, 1.0)[kept].clip(0, 1)
    lines, _ = cv2.findContours(
        covered[kept].astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE
    )
    rows = len(picture)
    outline = tuple(
        (np.concatenate([line, line[:1]])[:, 0] * (1, -1) + (0.5, rows - 0.5)) * PIXEL
        for line in lines
    )
    return Artwork(panel.name, np.rint(picture * 255).astype(np.uint8), inked[kept], outline)


def markdown(report: SheetReport) -> str:
    """The report as tables."""
    lines = [
        f"# Sheets of {report.run} at {report.scale}",
        "",
        f"{report.pages} pages of {report.paper}; printer: {report.printer}. The panels "
        f"hold {report.printed_share:.1%} of the painted outside.",
        "",
        "| panel | width, mm | height, mm | stretch, 95 % of the area | mean ΔE2000 |",
        "|---|---|---|---|---|",
    ]
    for row in report.panels:
        lines.append(
            f"| {row.name} | {row.width:.1f} | {row.height:.1f} "
            f"| {row.stretch:.1%} | {row.mean_delta_e:.2f} |"
        )
    lines += ["", "| ΔE2000 of the paint | |", "|---|---|"]
    lines += [f"| {name} | {value:.2f} |" for name, value in report.color_change.items()]
    predicted = report.prediction or Prediction(views=0, detectors={})
    for name, seen in predicted.detectors.items():
        precision = seen.average_precision
        lines += ["", f"| before {name} | detection score | AP@0.5 |", "|---|---|---|"]
        for texture, score in seen.score.items():
            lines.append(f"| {texture} | {_cell(score, '.3f')} | {precision[texture]:.3f} |")
        lines += [
            "",
            f"Of the fall of the score from plain paint, printing takes away "
            f"{_cell(seen.lost, '.1%')}, over {predicted.views} held-out views.",
        ]
    return "\n".join(lines) + "\n"


def _cell(number: Estimate, form: str) -> str:
    """A value with its 95 % interval."""
    if None in astuple(number):
        return "undefined"
    return f"{number.value:{form}} [{number.low:{form}}, {number.high:{form}}]"


def _painted(scene: Scene, skin: Skin) -> np.ndarray | None:
    drawn = scene.vehicle.paint_mask
    return shown_in(read_mask(scene.base / drawn), skin.corners) if drawn else None


def _panel_row(panel: Panel, skin: Skin, change: np.ndarray, scale: float) -> PanelRow:
    """``change`` is ΔE2000 of each texel of the texture."""
    width, height = (panel.size * 1000 / scale).tolist()
    at_middles = _at_middles(change, skin, panel)
    areas = np.abs(np.linalg.det(panel.corners[:, 1:] - panel.corners[:, :1]))
    return PanelRow(
        name=panel.name,
        width=round(width, 2),
        height=round(height, 2),
        stretch=round(panel.stretch, 4),
        mean_delta_e=round(float(np.average(at_middles, weights=areas)), 3),
    )


def _at_middles(picture: np.ndarray, skin: Skin, panel: Panel) -> np.ndarray:
    """What a picture in UV space shows in the middle of each face of a panel."""
    rows, columns = picture.shape[:2]
    middle = skin.corners[panel.faces].mean(axis=1) * (columns, -rows) + (0, rows)
    column, row = middle.astype(int).clip(0, (columns - 1, rows - 1)).T
    return picture[row, column]


def _color_change(change: np.ndarray) -> dict[str, float]:
    return {
        "mean": round(float(change.mean()), 3),
        "median": round(float(np.median(change)), 3),
        "95th percentile": round(float(np.percentile(change, 95)), 3),
        "largest": round(float(change.max()), 3),
        f"share above {SEEN:g}": round(float((change > SEEN).mean()), 4),
    }


def _key(figure: Figure, panels: list[Panel], skin: Skin, texture: SrgbArray) -> None:
    """All panels where they lie on the car, side by side, with their names."""
    for row, side in enumerate(SIDES):
        axes = figure.add_axes((0.08, 0.12 + 0.168 * (len(SIDES) - 1 - row), 0.84, 0.16))
        axes.set_axis_off()
        axes.set_aspect("equal")
        for panel in (part for part in panels if part.name.startswith(side.name)):
            flat = skin.vertices[skin.faces[panel.faces]] @ np.array([side.u, side.v], float).T
            colors = _at_middles(texture, skin, panel).clip(0, 1)
            patches = PolyCollection(flat, facecolors=colors, edgecolors="face", lw=0.3)
            patches.set_rasterized(True)
            axes.add_collection(patches)
            middle = flat.mean(axis=(0, 1))
            box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0}
            axes.text(
                middle[0], middle[1], panel.name, fontsize=6, ha="center", va="center", bbox=box
            )
        axes.autoscale_view()
