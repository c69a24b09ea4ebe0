"""The figure of ``cnca accuracy``: error over time, and the pictures with their errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import SubFigure
from matplotlib.ticker import LogLocator, NullFormatter, PercentFormatter

from cnca.jobs.accuracy.records import AccuracyReport, MeasuredRung
from cnca.report import figures

SHOWN = 5
"""Rungs of the front whose pictures are shown."""
HOTTEST = 0.3
"""Relative error of a pixel at the end of the color scale."""
GAP = 1.22
"""Least ratio of the heights of two labels."""


@dataclass(frozen=True)
class Still:
    """A rung's picture around the vehicle."""

    caption: str
    picture: Float[np.ndarray, "h w 3"]
    """sRGB in [0, 1]."""
    error: Float[np.ndarray, "h w"] | None
    """Relative error of each pixel; None is the reference."""


def seconds_of(rung: MeasuredRung) -> float:
    """Processor seconds of a later call, forward."""
    return rung.seconds.steady.forward


def shown_rungs(report: AccuracyReport) -> list[MeasuredRung]:
    """Of the front, spread evenly over the logarithm of the error, fastest first."""
    front = sorted(
        (r for r in report.rungs if r.name in report.front and r.error > 0), key=seconds_of
    )
    if len(front) <= SHOWN:
        return front
    errors = np.log([rung.error for rung in front])
    wanted = np.linspace(errors[0], errors[-1], SHOWN)
    places = {int(np.abs(errors - error).argmin()) for error in wanted}
    return [front[place] for place in sorted(places)]


@figures.style()
def draw_figure(path: Path, report: AccuracyReport, stills: Sequence[Still]) -> None:
    """Error over time at the left; stills and the maps of their errors at the right."""
    figure = plt.figure(figsize=(13, 6.4), layout="constrained")
    grid = figure.add_gridspec(1, 2, width_ratios=(1, 1.35))
    _draw_front(figure.add_subfigure(grid[0]).subplots(), report)
    _draw_stills(figure.add_subfigure(grid[1]), stills)
    figures.save(figure, path)


def _draw_front(axes: Axes, report: AccuracyReport) -> None:
    rungs = [rung for rung in report.rungs if rung.error > 0]
    plain = [rung for rung in rungs if rung.target is None]
    axes.scatter(
        [seconds_of(r) for r in plain],
        [r.error for r in plain],
        s=10,
        color="0.7",
        label="fixed models and rays",
    )
    front = sorted((r for r in rungs if r.name in report.front), key=seconds_of)
    x, y = [seconds_of(r) for r in front], [r.error for r in front]
    axes.step(x, y, where="post", color="C0", label="none is faster and better")
    asked = [rung for rung in rungs if rung.target is not None]
    if asked:
        x, y = [seconds_of(r) for r in asked], [r.error for r in asked]
        axes.scatter(x, y, marker="*", s=110, color="C1", zorder=3, label="asked for by error")
    axes.set(xscale="log", yscale="log")
    for number, rung in enumerate(shown_rungs(report), 1):
        place = seconds_of(rung), rung.error
        box = {"boxstyle": "circle,pad=0.2", "fc": "white", "ec": "C0", "lw": 0.8}
        axes.annotate(f"{number}", place, (7, 9), textcoords="offset points", fontsize=7, bbox=box)
    _label(axes, asked)
    axes.set(xlabel="processor seconds of one view", ylabel="error of the vehicle's pixels")
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.yaxis.set_major_formatter(PercentFormatter(1, decimals=0))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(alpha=0.2)
    axes.set_title(f"{report.scene}, view {report.view.name}", fontsize=9)
    axes.legend(fontsize=7)


def _label(axes: Axes, asked: Sequence[MeasuredRung]) -> None:
    """What was asked for, one below the other at the right, with lines to the stars."""
    height = np.inf
    right = max((seconds_of(rung) for rung in asked), default=1.0)
    low, high = axes.get_xlim()
    axes.set_xlim(low, max(high, right * 25))
    for rung in sorted(asked, key=lambda rung: -rung.error):
        height = min(rung.error, height / GAP)
        axes.annotate(
            f"{rung.target:.0%} asked, {rung.error:.1%} got",
            (seconds_of(rung), rung.error),
            (right * 1.6, height),
            fontsize=7,
            va="center",
            arrowprops={"arrowstyle": "-", "color": "C1", "lw": 0.6},
        )


def _draw_stills(figure: SubFigure, stills: Sequence[Still]) -> None:
    """In two bands: each still above its errors."""
    columns = (len(stills) + 1) // 2
    cells = figure.subplots(4, columns, squeeze=False)
    for axes in cells.flat:
        axes.set_axis_off()
    scale = None
    for number, still in enumerate(stills):
        row, column = 2 * (number // columns), number % columns
        above, below = cells[row, column], cells[row + 1, column]
        mark = "" if still.error is None else f"{number + 1}: "
        above.imshow(still.picture.clip(0, 1), interpolation="nearest")
        above.set_title(f"{mark}{still.caption}", fontsize=8)
        if still.error is not None:
            scale = below.imshow(still.error, cmap="inferno", vmin=0, vmax=HOTTEST)
    if scale is not None:
        bar = figure.colorbar(scale, ax=cells, shrink=0.6, aspect=25, extend="max")
        bar.set_label("error of a pixel", fontsize=8)
        bar.ax.yaxis.set_major_formatter(PercentFormatter(1, decimals=0))
        bar.ax.tick_params(labelsize=8)
