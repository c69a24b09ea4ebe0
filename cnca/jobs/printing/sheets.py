"""Pictures of true size on sheets of paper, as PDF.  Lengths are millimetres, y upwards.

::

    +  · · · · · · · · · · · ·  +   marks at the corners of the area that is printed on
       panels, each under its name, or one part of a panel that is larger than
       the area; neighboring parts share a strip, with a mark at either end
    +  · · · · · · · · · · · ·  +
       ruler of 100 mm; page, scale
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib
import numpy as np
from jaxtyping import Bool, Float, UInt8
from matplotlib.axes import Axes
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke

from cnca.core.files import replacing

INCH = 25.4
PAPERS = {
    "A4": (210.0, 297.0),
    "A3": (297.0, 420.0),
    "A2": (420.0, 594.0),
    "A1": (594.0, 841.0),
    "Letter": (215.9, 279.4),
    "Tabloid": (279.4, 431.8),
}
"""Name → width and height (ISO 216, ANSI/ASME Y14.1)."""
DPI = 150
PIXEL = INCH / DPI
MARGIN, FOOT = 12.0, 28.0
"""Margins at the sides and above, where many printers cannot print, and below."""
OVERLAP = 12.0
"""Strip that neighboring parts of a panel share."""
GAP, LABEL = 4.0, 4.0
"""Between panels, and for a name under each."""
RULER = 100


@dataclass(frozen=True)
class Artwork:
    """What is cut out: a picture with its bleed, and the line to cut along."""

    name: str
    picture: UInt8[np.ndarray, "height width 3"]
    """sRGB, at :data:`DPI`; white where nothing is printed."""
    inked: Bool[np.ndarray, "height width"]
    outline: tuple[Float[np.ndarray, "_ 2"], ...]
    """Closed lines, from the picture's lower left corner."""

    @property
    def size(self) -> tuple[float, float]:
        """Width and height with bleed."""
        height, width = self.inked.shape
        return width * PIXEL, height * PIXEL

    def turned(self) -> Artwork:
        """The same, turned by a quarter to the left."""
        height = self.size[1]
        outline = tuple(np.stack([height - y, x], axis=1) for x, y in (o.T for o in self.outline))
        return replace(
            self, picture=np.rot90(self.picture), inked=np.rot90(self.inked), outline=outline
        )


@dataclass(frozen=True)
class Placed:
    """An artwork, or a window of it, on a page."""

    art: Artwork
    at: tuple[float, float]
    """Where the window's lower left corner lies in the area that is printed on."""
    window: tuple[float, float, float, float]
    """Left, bottom, right, top in the artwork."""
    part: str = ""
    """Which part it is, where there are several."""


Page = list[Placed]


def lay_out(arts: Sequence[Artwork], area: tuple[float, float]) -> list[Page]:
    """Fill pages with this printed area (width, height): whole artworks in rows, then parts."""
    whole, large = [], []
    for art in arts:
        ways = [turned for turned in (art, art.turned()) if _fits(turned, area)]
        if ways:
            whole.append(min(ways, key=lambda turned: turned.size[1]))
        else:
            large.append(art)
    pages = _rows(sorted(whole, key=lambda art: -art.size[1]), area)
    for art in large:
        upright, lying = _parts(art, area), _parts(art.turned(), area)
        pages += lying if len(lying) < len(upright) else upright
    return pages


def _fits(art: Artwork, area: tuple[float, float]) -> bool:
    return art.size[0] <= area[0] and art.size[1] + LABEL <= area[1]


def _rows(arts: Sequence[Artwork], area: tuple[float, float]) -> list[Page]:
    """Rows from the top, the highest artworks first."""
    pages: list[Page] = []
    left, bottom, below = 0.0, 0.0, 0.0
    for art in arts:
        width, height = art.size[0], art.size[1] + LABEL
        if left + width > area[0]:
            left, bottom = 0.0, below - GAP
        if not pages or bottom - height < 0:
            pages.append([])
            left, bottom = 0.0, area[1]
        if left == 0.0:
            below = bottom - height
        pages[-1].append(Placed(art, (left, bottom - art.size[1]), (0.0, 0.0, *art.size)))
        left += width + GAP
    return pages


def _parts(art: Artwork, area: tuple[float, float]) -> list[Page]:
    """One page for each part with anything printed on it."""
    steps = [extent - OVERLAP for extent in area]
    counts = [
        max(1, math.ceil((s - OVERLAP) / step)) for s, step in zip(art.size, steps, strict=True)
    ]
    windows = [
        (x * steps[0], y * steps[1], x * steps[0] + area[0], y * steps[1] + area[1])
        for y in reversed(range(counts[1]))
        for x in range(counts[0])
    ]
    windows = [window for window in windows if _cut(art.inked, window)[0].any()]
    return [
        [Placed(art, (0.0, 0.0), window, f", part {number} of {len(windows)}")]
        for number, window in enumerate(windows, start=1)
    ]


def _cut(
    pixels: np.ndarray, window: tuple[float, float, float, float]
) -> tuple[np.ndarray, tuple[float, float, float, float]]:
    """The pixels that a window shows, and where they lie: left, right, bottom, top."""
    height, width = pixels.shape[:2]
    left, right = math.floor(window[0] / PIXEL), min(math.ceil(window[2] / PIXEL), width)
    bottom, top = math.floor(window[1] / PIXEL), min(math.ceil(window[3] / PIXEL), height)
    cut = pixels[height - top : height - bottom, left:right]
    return cut, (left * PIXEL, right * PIXEL, bottom * PIXEL, top * PIXEL)


def printed_area(paper: str) -> tuple[float, float]:
    """Width and height of what is printed on, beside the ruler."""
    width, height = PAPERS[paper]
    return width - 2 * MARGIN, height - MARGIN - FOOT


def write_pdf(
    path: Path,
    paper: str,
    pages: Sequence[Page],
    title: str,
    key: Callable[[Figure], None],
    advance: Callable[[], None] = lambda: None,
) -> None:
    """Write a first page on which ``key`` draws, then the pages; whole or not at all.

    ``advance`` is called after each page.
    """
    count = len(pages) + 1
    with (
        matplotlib.rc_context({"pdf.fonttype": 42}),
        replacing(path) as temporary,
        PdfPages(temporary, metadata={"Title": title}) as file,
    ):
        for number, page in enumerate([[], *pages], start=1):
            figure, axes = _blank(paper)
            _foot(axes, f"{title}, page {number} of {count}")
            if number == 1:
                key(figure)
            for placed in page:
                _draw(axes, placed)
            file.savefig(figure, dpi=DPI)
            advance()


def _blank(paper: str) -> tuple[Figure, Axes]:
    """A page whose coordinates are millimetres from its lower left corner."""
    width, height = PAPERS[paper]
    figure = Figure(figsize=(width / INCH, height / INCH))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, width), ylim=(0, height))
    axes.set_axis_off()
    for x in (MARGIN, width - MARGIN):
        for y in (FOOT, height - MARGIN):
            _mark(axes, x + math.copysign(4, x - width / 2), y + math.copysign(4, y - height / 2))
    return figure, axes


def _foot(axes: Axes, text: str) -> None:
    """The ruler, 100 mm from the first tick to the last, and a line of text."""
    bottom = FOOT - 14
    axes.plot([MARGIN, MARGIN + RULER], [bottom, bottom], color="black", lw=0.4)
    for x in range(0, RULER + 1, 5):
        high = 3.0 if x % 50 == 0 else 2.0 if x % 10 == 0 else 1.2
        axes.plot([MARGIN + x] * 2, [bottom, bottom + high], color="black", lw=0.3)
    axes.text(MARGIN + RULER + 3, bottom, f"{RULER} mm: print at 100 %, not fitted", fontsize=7)
    axes.text(MARGIN, bottom - 6, text, fontsize=7)


def _mark(axes: Axes, x: float, y: float, size: float = 2.5) -> None:
    """A cross in a circle."""
    axes.plot([x - size, x + size], [y, y], color="black", lw=0.3)
    axes.plot([x, x], [y - size, y + size], color="black", lw=0.3)
    turn = np.linspace(0, 2 * np.pi, 33)
    axes.plot(x + size / 2 * np.cos(turn), y + size / 2 * np.sin(turn), color="black", lw=0.3)


def _draw(axes: Axes, placed: Placed) -> None:
    """Picture, cut line and name; where it is a part, marks in the strips that it shares."""
    art, window = placed.art, placed.window
    x, y = MARGIN + placed.at[0] - window[0], FOOT + placed.at[1] - window[1]
    limits = axes.axis()
    cut, (left, right, bottom, top) = _cut(art.picture, window)
    extent = (x + left, x + right, y + bottom, y + top)
    image = axes.imshow(cut, extent=extent, aspect="auto", interpolation="none")
    frame = Rectangle(
        (x + window[0], y + window[1]), window[2] - window[0], window[3] - window[1], fill=False
    )
    frame.set_transform(axes.transData)
    image.set_clip_path(frame)
    for line in art.outline:
        (drawn,) = axes.plot(x + line[:, 0], y + line[:, 1], color="black", lw=0.25)
        drawn.set_path_effects([withStroke(linewidth=0.8, foreground="white")])
        drawn.set_clip_path(frame)
    if placed.part:
        for seam, neighbour in ((window[0], -1), (window[2], 1)):
            if 0 < seam < art.size[0]:
                for end in (window[1], window[3]):
                    _mark(axes, x + seam - neighbour * OVERLAP / 2, y + end)
        for seam, neighbour in ((window[1], -1), (window[3], 1)):
            if 0 < seam < art.size[1]:
                for end in (window[0], window[2]):
                    _mark(axes, x + end, y + seam - neighbour * OVERLAP / 2)
        axes.text(MARGIN, FOOT - 4, art.name + placed.part, fontsize=8)
    else:
        axes.text(x, y - 3, art.name, fontsize=7)
    axes.axis(limits)
