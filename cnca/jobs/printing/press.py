"""What a printer makes of a color: the nearest one that its inks can show, as the eye sees it.

Without a profile the inks are those of sheet-fed offset on coated paper.  Their tones follow
Neugebauer (1937): a halftone is a mosaic of paper, inks and overprints, whose shares are the
products of the inks' shares (Demichel, 1924), and whose tristimulus values add.  Shares are those
on paper: what the screen gains in print is the printer's to correct.

Colors are compared absolutely (white is the paper), in CIELAB under D50 and the 2° observer.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from itertools import product
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from cnca.core.errors import RunError
from cnca.core.images import SrgbArray

Lab = Float[np.ndarray, "colors 3"]
Inks = Float[np.ndarray, "colors 4"]
"""Shares of the paper covered by cyan, magenta, yellow and black, in [0, 1]."""
Press = Callable[[SrgbArray], SrgbArray]
"""A picture → how it looks in print."""

SOLIDS = {
    (0, 0, 0, 0): (95, 0, -2),
    (1, 0, 0, 0): (55, -37, -50),
    (0, 1, 0, 0): (48, 74, -3),
    (0, 0, 1, 0): (89, -5, 93),
    (0, 1, 1, 0): (47, 68, 48),
    (1, 0, 1, 0): (50, -65, 27),
    (1, 1, 0, 0): (24, 22, -46),
    (1, 1, 1, 0): (23, 0, 0),
    (0, 0, 0, 1): (16, 0, 0),
    (1, 0, 0, 1): (10.41, -8.20, -10.25),
    (0, 1, 0, 1): (10.42, 13.93, 1.35),
    (0, 0, 1, 1): (15.71, -3.08, 11.68),
    (0, 1, 1, 1): (11.33, 8.61, 7.28),
    (1, 0, 1, 1): (11.32, -12.88, 3.56),
    (1, 1, 0, 1): (7.88, 5.79, -5.94),
    (1, 1, 1, 1): (8.71, -0.07, 2.06),
}
"""Solid cyan, magenta, yellow, black → CIELAB on white backing: the full-tone patches of Fogra's
characterization data FOGRA39L (December 2006; offset after ISO 12647-2:2004/Amd 1, coated paper),
which Debian's package icc-profiles-free holds as FOGRA39L.ti3."""
GRID, START = 25, 7
"""Colors per axis of sRGB that are looked up, and of inks to start the search from."""
STEPS = 30
ENOUGH = 1e-4
"""ΔE*ab that one more step must gain for the search to go on."""


def load_press(profile: Path | None) -> Press:
    """The press that an ICC ``profile`` describes; without one, offset on coated paper.

    Raises RunError for a file that is no profile of an RGB or CMYK printer.
    """
    return _of_profile(profile) if profile else _of_table(*_offset_table())


def lab_of_srgb(srgb: Float[np.ndarray, "*shape 3"]) -> Float[np.ndarray, "*shape 3"]:
    """CIELAB under D50 (Bradford adaptation) of sRGB values in [0, 1]."""
    import colour

    xyz = colour.RGB_to_XYZ(srgb, "sRGB", illuminant=_d50(), apply_cctf_decoding=True)
    return colour.XYZ_to_Lab(xyz, _d50())


def srgb_of_lab(lab: Float[np.ndarray, "*shape 3"]) -> Float[np.ndarray, "*shape 3"]:
    """sRGB values of CIELAB under D50, clipped to [0, 1]."""
    import colour

    xyz = colour.Lab_to_XYZ(lab, _d50())
    return colour.XYZ_to_RGB(xyz, "sRGB", illuminant=_d50(), apply_cctf_encoding=True).clip(0, 1)


def difference(
    one: Float[np.ndarray, "*shape 3"], other: Float[np.ndarray, "*shape 3"]
) -> Float[np.ndarray, "*shape"]:
    """ΔE2000 (CIE 142:2001) of sRGB values, under D50."""
    import colour

    differences = colour.delta_E(lab_of_srgb(one), lab_of_srgb(other), method="CIE 2000")
    return np.asarray(differences)  # of one pair a number


def lab_of_inks(inks: Inks) -> Lab:
    """Neugebauer's sum over paper, inks and overprints, with Demichel's weights."""
    import colour

    solids = colour.Lab_to_XYZ(np.array(list(SOLIDS.values()), float), _d50())
    covered = np.array(list(SOLIDS), bool)
    shares = np.where(covered, inks[:, None], 1 - inks[:, None]).prod(axis=2)
    return colour.XYZ_to_Lab(shares @ solids, _d50())


def nearest_inks(wanted: Lab) -> Inks:
    """The inks whose color comes nearest (ΔE*ab), by a projected Levenberg–Marquardt search."""
    start = np.array(list(product(np.linspace(0, 1, START), repeat=4)))
    inks = start[cKDTree(lab_of_inks(start)).query(wanted)[1]]
    error, damping = lab_of_inks(inks) - wanted, np.full(len(wanted), 1.0)
    for _ in range(STEPS):
        slopes = _slopes(inks)
        gradient = np.einsum("nlk,nl->nk", slopes, error)
        stuck = ((inks <= 0) & (gradient > 0)) | ((inks >= 1) & (gradient < 0))
        slopes = np.where(stuck[:, None], 0.0, slopes)
        normal = np.einsum("nlk,nlm->nkm", slopes, slopes) + damping[:, None, None] * np.eye(4)
        step = np.linalg.solve(normal, np.where(stuck, 0.0, gradient)[..., None])[..., 0]
        tried = (inks - step).clip(0, 1)
        found = lab_of_inks(tried) - wanted
        gain = np.linalg.norm(error, axis=1) - np.linalg.norm(found, axis=1)
        better = gain > 0
        inks, error = (
            np.where(better[:, None], tried, inks),
            np.where(better[:, None], found, error),
        )
        damping = np.where(better, damping / 3, damping * 5)
        if gain.max() < ENOUGH:
            break
    return inks


def _slopes(inks: Inks) -> Float[np.ndarray, "colors 3 4"]:
    """Derivatives of CIELAB by the inks, by differences toward the middle of their range."""
    here, columns = lab_of_inks(inks), []
    for ink in range(4):
        moved = inks.copy()
        change = np.where(inks[:, ink] > 0.5, -1e-4, 1e-4)
        moved[:, ink] += change
        columns.append((lab_of_inks(moved) - here) / change[:, None])
    return np.stack(columns, axis=2)


def _offset_table() -> tuple[Float[np.ndarray, " grid"], Float[np.ndarray, "grid grid grid 3"]]:
    """sRGB levels, and what offset printing makes of each of their combinations."""
    levels = np.linspace(0, 1, GRID)
    colors = np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), -1).reshape(-1, 3)
    printed = srgb_of_lab(lab_of_inks(nearest_inks(lab_of_srgb(colors))))
    return levels, printed.reshape(GRID, GRID, GRID, 3)


def _of_table(
    levels: Float[np.ndarray, " grid"], printed: Float[np.ndarray, "grid grid grid 3"]
) -> Press:
    from scipy.interpolate import RegularGridInterpolator

    lookup = RegularGridInterpolator((levels, levels, levels), printed)
    return lambda picture: lookup(picture).astype(np.float32)


def _of_profile(path: Path) -> Press:
    """By LittleCMS, absolute colorimetric there and back, in steps of 1/255."""
    from PIL import Image, ImageCms

    try:
        profile = ImageCms.getOpenProfile(io.BytesIO(path.read_bytes()))
        mode = {"RGB": "RGB", "CMYK": "CMYK"}[profile.profile.xcolor_space.strip()]
        ends = ImageCms.createProfile("sRGB"), profile
        intent = ImageCms.Intent.ABSOLUTE_COLORIMETRIC
        there = ImageCms.buildTransform(*ends, "RGB", mode, renderingIntent=intent)
        back = ImageCms.buildTransform(*ends[::-1], mode, "RGB", renderingIntent=intent)
    except (OSError, KeyError, ImageCms.PyCMSError) as error:
        reason = " ".join(str(error).split())
        raise RunError(
            f"--profile {path}: is no ICC profile of an RGB or CMYK printer ({reason})"
        ) from None

    def press(picture: SrgbArray) -> SrgbArray:
        levels = np.rint(picture.clip(0, 1) * 255).astype(np.uint8)
        printed = ImageCms.applyTransform(Image.fromarray(levels), there)
        assert printed is not None
        seen = ImageCms.applyTransform(printed, back)
        return np.asarray(seen, np.float32) / 255

    return press


def _d50() -> Float[np.ndarray, "2"]:
    import colour

    return colour.CCS_ILLUMINANTS["CIE 1931 2 Degree Standard Observer"]["D50"]
