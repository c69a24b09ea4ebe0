"""Curves as SVG that takes its colors from the page, so that they read in light and dark."""

from __future__ import annotations

import re
from collections.abc import Sequence
from io import StringIO
from typing import Any

import matplotlib

matplotlib.use("Agg")
from markupsafe import Markup
from matplotlib import pyplot as plt

INK = "#010203"
"""A color that nothing else has; the page's own takes its place."""
LINE = "#c8640a"
"""At least 3 : 1 on light and on dark paper."""
SETTINGS: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "cnca",
    "font.family": "sans-serif",
    "font.size": 11,
    **{f"{what}.color": INK for what in ("text", "xtick", "ytick")},
    **{f"axes.{what}": INK for what in ("edgecolor", "labelcolor")},
    "axes.spines.top": False,
    "axes.spines.right": False,
}


def draw(steps: Sequence[int], numbers: Sequence[float], name: str) -> Markup:
    """A number over the steps; screen readers hear where it begins and ends."""
    with plt.rc_context(SETTINGS):
        figure, axes = plt.subplots(figsize=(5, 2.8), layout="constrained")
        axes.plot(steps, numbers, color=LINE)
        axes.set(xlabel="step", ylabel=name, ylim=(0, None))
        text = StringIO()
        figure.savefig(text, format="svg", transparent=True, metadata={"Date": None})
        plt.close(figure)
    drawing = text.getvalue()
    drawing = drawing[drawing.index("<svg ") :].removeprefix("<svg ").replace(INK, "currentColor")
    drawing = re.sub(r"<metadata>.*?</metadata>", "", drawing, flags=re.DOTALL)
    prefix = name.partition(",")[0].replace(" ", "-")  # ids of one drawing are not another's
    drawing = re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{prefix}-", drawing)
    heard = f"{name}: {numbers[0]:.2f} at first, {numbers[-1]:.2f} at last"
    opened = Markup('<svg class="curve" role="img" aria-label="{}" ').format(heard)
    return opened + Markup(drawing)
