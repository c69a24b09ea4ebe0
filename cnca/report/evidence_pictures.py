"""The pictures of an evaluation: AP by pose and weather with bands, and what the detectors saw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import astuple
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt

from cnca.core.detections import ALARM
from cnca.core.pictures import SrgbPicture, as_pictures, draw_boxes, side_by_side
from cnca.core.types import SrgbImages
from cnca.judge.records import SectionScores
from cnca.judge.stage import Eye, Stage
from cnca.judge.verdict import Seen
from cnca.report import figures

SHOWN_VIEWS = 6
UNITS = {
    "elevation": "elevation (°)",
    "azimuth": "azimuth (°)",
    "distance": "distance (m)",
    "visibility": "fog: visibility (m)",
    "sun": "sun altitude (°)",
}


@figures.style()
def plot_sections(out: Path, sections: Mapping[str, Sequence[SectionScores]]) -> str:
    """The paper's figure of AP by elevation, azimuth, distance, fog and sun; 95 % bands.

    Axes along which the views do not differ are left out.  Returns the name of the file in ``out``.
    """
    axes_shown = {axis: parts for axis, parts in sections.items() if len(parts) > 1}
    axes_shown = axes_shown or dict(list(sections.items())[:1])
    figure, panels = plt.subplots(
        1, len(axes_shown), figsize=(3.4 * len(axes_shown), 3.6), sharey=True, layout="constrained"
    )
    for panel, (axis, parts) in zip(np.atleast_1d(panels), axes_shown.items(), strict=True):
        places = np.arange(len(parts))
        for row in parts[0].AP_voc:
            value, low, high = _band(parts, row)
            (line,) = panel.plot(places, value, marker="o", markersize=3, label=row)
            panel.fill_between(places, low, high, color=line.get_color(), alpha=0.12, lw=0)
        panel.set_xticks(places, [part.label for part in parts], fontsize=8)
        panel.set(xlabel=UNITS[axis], ylim=(0, 1.02))
    np.atleast_1d(panels)[0].set_ylabel("AP@0.5 (VOC, car)")
    handles, labels = np.atleast_1d(panels)[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 6))
    return figures.save(figure, out / "sections.png")


@figures.style()
def plot_azimuths(out: Path, sections: Mapping[str, Sequence[SectionScores]]) -> list[str]:
    """AP around the vehicle, its front to the top, with 95 % bands; needs three azimuths."""
    parts = sections["azimuth"]
    if len(parts) < 3:
        return []
    figure, axes = plt.subplots(
        figsize=(5, 5.6), subplot_kw={"projection": "polar"}, layout="constrained"
    )
    axes.set_theta_zero_location("N")  # type: ignore[attr-defined]
    closed = [*parts, parts[0]]
    places = [part.place for part in parts if part.place is not None]  # all: no sector is clear air
    angles = np.radians([*places, places[0] + 360])
    for row in parts[0].AP_voc:
        value, low, high = _band(closed, row)
        (line,) = axes.plot(angles, value, label=row)
        axes.fill_between(angles, low, high, color=line.get_color(), alpha=0.12, lw=0)
    axes.set_ylim(0, 1)
    figure.legend(loc="outside lower center", ncols=3)
    return [figures.save(figure, out / "azimuths.png")]


def contact_sheet(
    stage: Stage, eye: Eye, seen: Mapping[str, Mapping[str, Seen]], first: int
) -> SrgbPicture:
    """Rows of views, one for each texture, with what one detector reports at 0.25 or more.

    ``first`` is the number of the stage's first view among those that ``seen`` holds.
    """
    count = len(stage.places)
    columns = min(SHOWN_VIEWS, count)
    # Strides by the golden ratio: equal ones would show one weather or azimuth again and again.
    chosen = sorted({int(k * 0.618034 * count) % count for k in range(columns)})
    boxes = stage.boxes()
    tiles, captions = [], []
    for row, by_detector in seen.items():
        for view in chosen:
            weather, place = stage.places[view]
            picture = as_pictures(SrgbImages(stage.pictures(row, weather)[place : place + 1]))[0]
            reports = by_detector[eye.name]
            sure = reports.detections[first + view].above(ALARM)
            tiles.append(draw_boxes(picture, sure, reports.class_names, boxes[view]))
            captions.append(row)
    return side_by_side(tiles, captions, columns=len(chosen))


def _band(parts: Sequence[SectionScores], row: str) -> np.ndarray:
    """Value, low and high of one row in each section; NaN where undefined."""
    numbers = [part.AP_voc[row] for part in parts]
    return np.array([astuple(number) for number in numbers], float).T
