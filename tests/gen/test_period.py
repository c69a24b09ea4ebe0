"""The period of a pattern is that of the stripes that it is made of."""

import numpy as np
import pytest
import torch

from cnca.core.types import SrgbTexture
from cnca.gen.period import period


def stripes(pixels, angle=0.0, size=256):
    y, x = np.mgrid[:size, :size]
    phase = (x * np.cos(angle) + y * np.sin(angle)) / pixels
    values = 0.5 + 0.4 * np.sin(2 * np.pi * phase)
    return SrgbTexture(torch.from_numpy(values).float().expand(3, size, size))


@pytest.mark.parametrize("pixels", [8, 20, 48.5])
@pytest.mark.parametrize("angle", [0.0, 0.7, np.pi / 2])
def test_stripes_in_any_direction(pixels, angle):
    assert period(stripes(pixels, angle)) == pytest.approx(pixels, rel=0.05)


def test_sharp_edges_do_not_make_them_finer():
    sharp = (stripes(32) > 0.5).float()
    assert period(SrgbTexture(sharp)) == pytest.approx(32, rel=0.05)


def test_repeating_divides_it():
    once = stripes(32)
    assert period(SrgbTexture(once.repeat(1, 2, 2)[:, ::2, ::2])) == pytest.approx(16, rel=0.05)


def test_plain_paint_has_none():
    assert period(SrgbTexture(torch.full((3, 64, 64), 0.3))) == float("inf")
