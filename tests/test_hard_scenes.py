"""Every scene in ``scenes/hard`` renders and differentiates; ``tests/hard`` has the truths."""

from __future__ import annotations

import re

import numpy as np
import pytest

from tests.hard.looks import HUGE, NAMES, SCENES, look


def test_there_are_many_and_the_readme_names_each():
    listed = re.findall(r"^\| `(\w+)` ", (SCENES / "README.md").read_text(), re.MULTILINE)
    assert sorted(listed) == NAMES
    assert len(NAMES) >= 50


@pytest.mark.parametrize("name", NAMES)
def test_picture_and_gradient_are_finite_and_of_the_right_sign(name):
    seen = look(name)
    assert np.isfinite(seen.images).all()
    assert (seen.images >= 0).all()
    assert np.isfinite(seen.gradients).all()
    # Brighter paint never darkens a picture; what is left of a path after its light is rounded.
    assert seen.gradients.min() >= -1e-6 * seen.gradients.max()


@pytest.mark.parametrize("name", sorted(set(NAMES) - HUGE))
def test_the_gradient_on_a_pictures_own_paths_is_its_derivative(name):
    found, expected = look(name).slopes
    # float32 rounds each pixel to 6e-8 of its value, and sums of gradients likewise.
    assert found == pytest.approx(expected, rel=1e-3, abs=1e-7 * float(look(name).image.max()))
