"""Plots as papers take them."""

import re
import zlib

import cv2
import numpy as np
import pytest
from matplotlib import pyplot as plt

from cnca.core.errors import RunError
from cnca.core.options import FIGURE_FORMAT, figure_formats
from cnca.report import figures


@figures.style()
def draw(path):
    figure, axes = plt.subplots(figsize=(3, 2))
    axes.plot([1, 2, 3], [1, 4, 9], label="score")
    axes.legend()
    return figures.save(figure, path)


def streams(pdf):
    """What a PDF holds, unpacked."""
    packed = re.findall(rb"stream\r?\n(.*?)\r?\nendstream", pdf, re.DOTALL)
    for content in packed:
        try:
            yield zlib.decompress(content)
        except zlib.error:
            yield content


def test_png_alone_unless_asked_for_more(tmp_path, monkeypatch):
    monkeypatch.delenv(FIGURE_FORMAT, raising=False)
    assert draw(tmp_path / "plot.png") == "plot.png"
    assert [path.name for path in tmp_path.iterdir()] == ["plot.png"]
    assert cv2.imread(str(tmp_path / "plot.png")).shape == (240, 360, 3)


def test_pdf_and_svg_beside_it(tmp_path, monkeypatch):
    """TrueType fonts inside (type 42), none of type 3, and the same bytes each time."""
    monkeypatch.setenv(FIGURE_FORMAT, "pdf,svg")
    draw(tmp_path / "plot.png")
    pdf, svg = ((tmp_path / f"plot.{ending}").read_bytes() for ending in ("pdf", "svg"))
    text = pdf + b"".join(streams(pdf))
    assert b"/CIDFontType2" in text
    assert b"/Type3" not in text
    assert svg.lstrip().startswith(b"<?xml")
    draw(tmp_path / "again.png")
    assert (tmp_path / "again.pdf").read_bytes() == pdf
    assert (tmp_path / "again.svg").read_bytes() == svg


# Of the retina's cones, seen by people without the red or the green ones (Machado et al. 2009).
DEFICIENT = {
    "protan": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
    "deutan": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
}


@pytest.mark.parametrize("kind", DEFICIENT)
def test_colors_stay_apart_for_the_color_blind(kind):
    hexes = [bytes.fromhex(color[1:]) for color in figures.PALETTE]
    linear = (np.array([list(color) for color in hexes]) / 255) ** 2.2
    seen = np.clip(linear @ np.array(DEFICIENT[kind]).T, 0, 1).astype(np.float32)
    lab = cv2.cvtColor(seen[None] ** np.float32(1 / 2.2), cv2.COLOR_RGB2LAB)[0]
    apart = np.linalg.norm(lab[:, None] - lab[None], axis=-1) + 1e3 * np.eye(len(lab))
    assert apart.min() > 10  # ΔE76; 2.3 is just noticeable


def test_other_formats_are_refused():
    assert figure_formats("png") == []
    assert figure_formats("svg, PDF") == [".pdf", ".svg"]
    with pytest.raises(RunError, match="png, pdf or svg"):
        figure_formats("eps")
