"""Sheets of true size: the ruler and a panel are measured on pages that pdftoppm has drawn."""

import json
import shutil
import subprocess

import cv2
import numpy as np
import pytest
import torch
from rich.console import Console

from cnca.core.errors import RunError
from cnca.core.images import write_texture_srgb
from cnca.core.records import read_record
from cnca.jobs.printing import sheets
from cnca.jobs.printing.print_sheets import SheetReport, artwork, print_sheets, read_scale
from cnca.jobs.printing.printed_run import Run, predict, read_run
from cnca.jobs.printing.sheets import (
    MARGIN,
    OVERLAP,
    PAPERS,
    PIXEL,
    Artwork,
    lay_out,
    printed_area,
    write_pdf,
)
from cnca.judge.records import Estimate
from cnca.vehicle.builtin.sedan import build_sedan
from cnca.vehicle.model import Part, Vehicle
from cnca.vehicle.uv.develop import Panel, develop
from cnca.vehicle.uv.skin import Skin

DPI = 300
"""Of the pages as they are measured."""


def _board(width: float, height: float) -> tuple[Skin, Panel]:
    """A flat red panel of so many metres."""
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], float)
    vertices = np.column_stack([-corners[:, 0], np.zeros(4), corners[:, 1]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    normals = np.tile([0.0, 1.0, 0.0], (4, 1))
    part = Part("board", "paint", vertices, faces, normals, corners / max(width, height))
    panels, share = develop(Vehicle("board", (part,)))
    assert share == 1
    return Skin.of(Vehicle("board", (part,))), panels[0]


def _pages(pdf, folder) -> list[np.ndarray]:
    """Grey levels of each page at :data:`DPI`."""
    if shutil.which("pdftoppm") is None:
        pytest.skip("needs pdftoppm (apt install poppler-utils)")
    subprocess.run(["pdftoppm", "-r", str(DPI), "-png", pdf, folder / "page"], check=True)
    return [cv2.imread(str(file)) for file in sorted(folder.glob("page*.png"))]


def _millimetres(pixels: float) -> float:
    return pixels * 25.4 / DPI


@pytest.fixture(scope="module")
def printed(tmp_path_factory):
    """A board of 1.5 × 0.6 m at 1:12, and one of 5.4 × 0.6 m: 125 × 50 and 450 × 50 mm."""
    folder = tmp_path_factory.mktemp("pdf")
    texture = np.full((32, 32, 3), (1.0, 0.0, 0.0), np.float32)
    arts = []
    for width in (1.5, 5.4):
        skin, panel = _board(width, 0.6)
        arts.append(artwork(panel, skin, texture, 12))
    pages = lay_out(arts, printed_area("A4"))
    write_pdf(folder / "sheets.pdf", "A4", pages, "test", lambda figure: None)
    return arts, pages, _pages(folder / "sheets.pdf", folder)


def test_pages_are_as_large_as_the_paper(printed):
    for page in printed[2]:
        width, height = (_millimetres(pixels) for pixels in page.shape[1::-1])
        assert (width, height) == pytest.approx(PAPERS["A4"], abs=0.1)


def test_the_ruler_is_100_mm_long(printed):
    """From its first tick to its last: the longest dark row of each page."""
    for page in printed[2]:
        dark = page.max(axis=2) < 128
        row = dark[-round(sheets.FOOT / 25.4 * DPI) :].sum(axis=1).argmax()
        columns = np.flatnonzero(dark[len(dark) - round(sheets.FOOT / 25.4 * DPI) + row])
        runs = np.split(columns, np.flatnonzero(np.diff(columns) > 1) + 1)
        ruler = max(runs, key=len)
        assert _millimetres(len(ruler)) == pytest.approx(100, abs=0.5)
        assert _millimetres(ruler[0]) == pytest.approx(MARGIN, abs=0.5)


def test_a_panel_is_as_large_as_on_the_car_over_twelve(printed):
    """The first board, red with 3 mm of bleed around 125 × 50 mm."""
    page = printed[2][1].astype(int)
    red = (page[..., 2] > 200) & (page[..., 1] < 100)
    width, height = (_millimetres(np.ptp(np.flatnonzero(red.any(axis=a))) + 1) for a in (0, 1))
    assert width - 6 == pytest.approx(125, abs=0.5)
    assert height - 6 == pytest.approx(50, abs=0.5)


def test_a_long_panel_is_cut_into_parts_that_overlap(printed):
    arts, pages, _ = printed
    parts = [placed for page in pages[1:] for placed in page]
    assert len(parts) == len(pages) - 1 == 2  # turned: 456 mm with bleed on pages of 257 mm
    windows = [placed.window for placed in parts]
    art = parts[0].art
    covered = sorted((window[1], window[3]) for window in windows)
    assert covered[0][0] == 0
    assert covered[-1][1] >= art.size[1]
    assert covered[0][1] - covered[1][0] == pytest.approx(OVERLAP)


def test_rows_neither_overlap_nor_leave_the_page():
    rng = np.random.default_rng(0)
    arts = []
    for number in range(40):
        height, width = rng.integers(60, 700, 2)
        blank = np.zeros((height, width), bool)
        arts.append(Artwork(str(number), np.zeros((height, width, 3), np.uint8), blank, ()))
    area = printed_area("A4")
    pages = lay_out(arts, area)
    names = [placed.art.name for page in pages for placed in page]
    assert sorted(names, key=int) == [str(number) for number in range(40)]
    for page in pages:
        boxes = [(*p.at, p.at[0] + p.art.size[0], p.at[1] + p.art.size[1]) for p in page]
        for i, (left, bottom, right, top) in enumerate(boxes):
            assert left >= 0
            assert right <= area[0]
            assert bottom >= 0
            assert top <= area[1] + 1e-9
            for other in boxes[:i]:
                apart = (
                    left >= other[2] or right <= other[0] or bottom >= other[3] or top <= other[1]
                )
                assert apart


def test_the_outline_is_the_panels_own():
    skin, panel = _board(0.9, 0.5)
    art = artwork(panel, skin, np.zeros((4, 4, 3), np.float32), 10)
    span = np.ptp(np.concatenate(art.outline), axis=0)
    assert span == pytest.approx([90, 50], abs=2 * PIXEL)
    turned = np.ptp(np.concatenate(art.turned().outline), axis=0)
    assert turned == pytest.approx(span[::-1])
    assert art.turned().turned().turned().turned().outline[0] == pytest.approx(art.outline[0])


@pytest.mark.parametrize("text", ["12", "1:0", "1:-3", "2:1", "1:x"])
def test_what_is_no_scale_is_refused(text):
    with pytest.raises(RunError, match="write it as 1:12"):
        read_scale(text)


def test_scales():
    assert read_scale("1:12") == 12
    assert read_scale("1:7.5") == 7.5


def test_a_folder_without_a_finished_run_is_refused(tmp_path):
    with pytest.raises(RunError, match=r"manifest\.json: not there"):
        read_run(tmp_path)


def test_paper_and_ending_are_checked_first(tmp_path):
    console = Console(quiet=True)
    with pytest.raises(RunError, match="did you mean 'A4'"):
        print_sheets(tmp_path, tmp_path / "x.pdf", paper="A44", console=console)
    with pytest.raises(RunError, match="end the name with .pdf"):
        print_sheets(tmp_path, tmp_path / "x.png", console=console)


def _run(folder, texture) -> None:
    """A finished run of one held-out view, as far as print-sheets reads it."""
    (folder / "scene.yaml").write_text(
        "{vehicle: {texture_size: 32}, image: {width: 32, height: 32, samples: 2}}"
    )
    request = {
        "scene": str(folder / "scene.yaml"),
        "detector": "builtin",
        "backend": "mitsuba",
        "held_out_views": 2,
        "settings": {"seed": 0},
    }
    (folder / "manifest.json").write_text(json.dumps({"request": request}))
    (folder / "summary.json").write_text("{}")
    write_texture_srgb(folder / "texture.png", texture)


def test_the_whole_command_on_the_sedan(tmp_path):
    texture = np.zeros((32, 32, 3), np.float32)
    texture[:, :16] = (0.0, 1.0, 0.0)  # a green that no press has
    texture[:, 16:] = 0.5
    _run(tmp_path, texture)
    report = print_sheets(tmp_path, tmp_path / "sheets.pdf", scale=43, console=Console(quiet=True))
    assert read_record(SheetReport, tmp_path / "sheets.json") == report
    assert (tmp_path / "sheets.pdf").read_bytes().startswith(b"%PDF")
    assert report.color_change["largest"] > 10
    panels, share = develop(build_sedan())
    assert report.printed_share == pytest.approx(share, abs=1e-4)
    for row, panel in zip(report.panels, panels, strict=True):
        assert row.width == pytest.approx(panel.size[0] * 1000 / 43, abs=0.01)
    text = (tmp_path / "sheets.md").read_text()
    assert "printing takes away" in text
    assert report.prediction.views == 2
    seen = report.prediction.detectors["builtin"]
    fall = seen.score["print"].value - seen.score["texture"].value
    assert seen.difference.value == pytest.approx(fall, abs=2e-4)


def test_what_prints_as_it_is_loses_nothing(tmp_path):
    _run(tmp_path, np.full((32, 32, 3), 0.5, np.float32))
    run: Run = read_run(tmp_path)
    same = predict(run, run.texture, Console(quiet=True))
    assert same.detectors["builtin"].difference == Estimate(0, 0, 0)
    assert torch.equal(run.texture, run.paint.resize(run.texture))
