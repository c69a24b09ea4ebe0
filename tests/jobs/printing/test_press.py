"""The press: solids against published conversions, the search against brute force, profiles."""

import numpy as np
import pytest
from PIL import ImageCms

from cnca.core.errors import RunError
from cnca.jobs.printing.press import (
    difference,
    lab_of_inks,
    lab_of_srgb,
    load_press,
    nearest_inks,
    srgb_of_lab,
)

PUBLISHED = {
    (1, 0, 0, 0): "009fe3",
    (0, 1, 0, 0): "e6007e",
    (0, 0, 1, 0): "ffed00",
    (0, 1, 1, 0): "e30613",
    (1, 0, 1, 0): "009640",
    (1, 1, 0, 0): "312783",
}
"""Inks → what Adobe's conversion of Coated FOGRA39 to sRGB (relative colorimetric) shows."""


@pytest.mark.parametrize("inks", PUBLISHED)
def test_solids_agree_with_the_published_conversion(inks):
    """Relative to the paper; out of sRGB's gamut both clip, each in its way, hence ΔE < 6."""
    import colour

    published = np.array([int(PUBLISHED[inks][i : i + 2], 16) for i in (0, 2, 4)]) / 255
    d50 = colour.CCS_ILLUMINANTS["CIE 1931 2 Degree Standard Observer"]["D50"]
    white = colour.xy_to_XYZ(d50)
    paper, ink = (
        colour.Lab_to_XYZ(lab_of_inks(np.array([each], float))[0], d50)
        for each in ((0, 0, 0, 0), inks)
    )
    relative = srgb_of_lab(colour.XYZ_to_Lab(ink * white / paper, d50))
    assert difference(relative, published) < 6


def test_what_can_be_printed_stays():
    """Colors of random inks are found again, whatever inks that takes."""
    inks = np.random.default_rng(0).uniform(0.05, 0.95, (200, 4))
    wanted = lab_of_inks(inks)
    found = lab_of_inks(nearest_inks(wanted))
    assert np.linalg.norm(found - wanted, axis=1).max() < 0.1


def test_what_cannot_comes_as_near_as_any_of_many_inks():
    rng = np.random.default_rng(1)
    wanted = lab_of_srgb(rng.integers(0, 2, (40, 3)).astype(float))
    found = np.linalg.norm(lab_of_inks(nearest_inks(wanted)) - wanted, axis=1)
    levels = np.linspace(0, 1, 21)
    many = lab_of_inks(np.stack(np.meshgrid(*[levels] * 4), -1).reshape(-1, 4))
    brute = np.array([np.linalg.norm(many - one, axis=1).min() for one in wanted])
    assert (found < brute + 1e-3).all()
    assert found.max() > 10


@pytest.fixture(scope="module")
def offset():
    return load_press(None)


def test_the_table_agrees_with_the_search(offset):
    """Between its nodes the table errs where the gamut's border passes."""
    colors = np.random.default_rng(2).random((300, 3)).astype(np.float32)
    direct = srgb_of_lab(lab_of_inks(nearest_inks(lab_of_srgb(colors))))
    errors = difference(offset(colors[None])[0], direct)
    assert np.median(errors) < 0.2
    assert np.percentile(errors, 95) < 1.5


def test_white_is_as_bright_as_paper_and_grey_stays(offset):
    white, grey = offset(np.array([[[1, 1, 1], [0.5, 0.5, 0.5]]], np.float32))[0]
    assert lab_of_srgb(white)[0] == pytest.approx(95, abs=0.2)
    assert difference(grey, np.full(3, 0.5)) < 0.1


def test_a_profile_of_srgb_changes_nothing(tmp_path):
    profile = tmp_path / "screen.icc"
    profile.write_bytes(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())
    picture = (np.random.default_rng(3).integers(0, 256, (8, 9, 3)) / 255).astype(np.float32)
    printed = load_press(profile)(picture)
    assert np.abs(printed - picture).max() < 1.5 / 255


@pytest.mark.parametrize("content", [None, b"", b"not a profile"])
def test_what_is_no_profile_is_refused(tmp_path, content):
    path = tmp_path / "bad.icc"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(RunError, match="no ICC profile"):
        load_press(path)


def test_a_profile_that_is_no_printers_is_refused(tmp_path):
    path = tmp_path / "lab.icc"
    lab = ImageCms.ImageCmsProfile(ImageCms.createProfile("LAB"))
    path.write_bytes(lab.tobytes())
    with pytest.raises(RunError, match="no ICC profile"):
        load_press(path)
