"""How plots look and are written: as PNG, and as PDF or SVG that a paper takes as they are.

Colors are those of Okabe and Ito, which people of all kinds of color vision tell apart; fonts are
embedded as TrueType (type 42), which publishers ask for.  What a plot shows is said beside it.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib import rcsetup

from cnca.core.files import replacing
from cnca.core.options import FIGURE_FORMAT, figure_formats

PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Of Okabe and Ito (2008), without their yellow, which white paper swallows."""
STYLE: Any = {
    "axes.prop_cycle": rcsetup.cycler(color=PALETTE),
    "pdf.fonttype": 42,
    "ps.fonttype": 42,
    "svg.fonttype": "path",
    "svg.hashsalt": "cnca",
}
DOTS = 120
"""Per inch, of PNG."""
UNDATED: dict[str, dict[str, Any]] = {".pdf": {"CreationDate": None}, ".svg": {"Date": None}}
"""The same numbers make the same file."""


@contextmanager
def style() -> Iterator[None]:
    """Draw and save plots in here; also a decorator, ``@style()``, of what does so."""
    with plt.rc_context(STYLE):
        yield


def save(figure: Any, path: Path) -> str:
    """Write a plot as PNG, and beside it in the formats that ``--figure-format`` asks for.

    Returns the name of the PNG; the plot is closed.  Raises RunError if it cannot be written.
    """
    for ending in (".png", *figure_formats(os.environ.get(FIGURE_FORMAT, ""))):
        with replacing(path.with_suffix(ending)) as temporary:
            figure.savefig(temporary, dpi=DOTS, metadata=UNDATED.get(ending))
    plt.close(figure)
    return path.with_suffix(".png").name
