"""Errors of pictures whose bias and noise are known."""

from __future__ import annotations

import colour
import numpy as np
import pytest
import torch

from cnca.jobs.accuracy.delta_e import mean_delta_e
from cnca.jobs.accuracy.fidelity import (
    DARK,
    error_of_mean,
    gradient_agreement,
    mean_bias,
    root,
    squared_bias,
    squared_error,
    squared_noise,
    vehicle_pixels,
)

PIXELS = 20_000
BIAS, NOISE, REFERENCE_NOISE = 0.03, 0.2, 0.02
"""A converged reference: its noise must not move the weights."""


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.fixture
def pictures(rng):
    """Truth, two renders with known bias and noise, two halves of a noisy reference."""
    truth = np.full((PIXELS, 3), 0.5)

    def render(bias: float, noise: float) -> np.ndarray:
        return truth + bias + noise * rng.normal(size=truth.shape)

    renders = render(BIAS, NOISE), render(BIAS, NOISE)
    return renders, (render(0, REFERENCE_NOISE), render(0, REFERENCE_NOISE))


WEIGHT = 1 / (0.5**2 + DARK)


def test_bias_and_noise_are_told_apart(pictures):
    renders, references = pictures
    bias, uncertainty = squared_bias(renders, references)
    assert abs(bias - BIAS**2 * WEIGHT) < 4 * uncertainty
    assert uncertainty < BIAS**2
    assert squared_noise(renders, references) == pytest.approx(NOISE**2 * WEIGHT, rel=0.03)
    error, uncertainty = squared_error(renders[0], references)
    assert error == pytest.approx((BIAS**2 + NOISE**2) * WEIGHT, rel=0.03)
    assert 0 < uncertainty < 0.05 * error


def test_noise_alone_is_no_bias(rng):
    a, b, *references = (
        0.5 + noise * rng.normal(size=(PIXELS, 3))
        for noise in (NOISE, NOISE, REFERENCE_NOISE, REFERENCE_NOISE)
    )
    bias, uncertainty = squared_bias((a, b), (references[0], references[1]))
    assert abs(bias) < 4 * uncertainty


def test_the_means_bias_is_found_with_its_error(pictures):
    renders, references = pictures
    bias, error = mean_bias(renders, references)
    # Noise of 6 × PIXELS independent numbers in both means.
    expected = np.hypot(NOISE, REFERENCE_NOISE) / np.sqrt(6 * PIXELS)
    assert error == pytest.approx(expected / 0.5, rel=0.05)
    assert abs(bias - BIAS / 0.5) < 4 * error


def test_colors_that_share_their_noise_are_one_number(rng):
    pair = [np.repeat(rng.normal(size=(PIXELS, 1)), 3, axis=1) for _ in range(2)]
    assert error_of_mean(pair) == pytest.approx(1 / np.sqrt(2 * PIXELS), rel=0.05)


def test_errors_are_relative_in_bright_pixels_and_absolute_in_dark_ones():
    for radiance, expected in ((100.0, 0.01), (0.0, 0.0)):
        reference = np.full((4, 3), radiance)
        square, _ = squared_error(reference * 1.01, (reference, reference))
        assert root(square) == pytest.approx(expected, rel=1e-3)
    dark = np.zeros((4, 3))
    square, _ = squared_error(dark + 0.001, (dark, dark))
    assert root(square) == pytest.approx(0.001 / DARK**0.5)
    assert root(-0.04) == pytest.approx(-0.2)


def test_delta_e_is_that_of_the_standard():
    """CIE 142:2001 through sRGB greys whose Lab is known: L* of linear 0.18 is 49.5."""
    a, b = np.full((5, 3), 0.18), np.full((5, 3), 0.20)
    lightness = [116 * y ** (1 / 3) - 16 for y in (0.18, 0.20)]
    lab = [np.array([value, 0.0, 0.0]) for value in lightness]
    expected = float(colour.delta_E(lab[0], lab[1], method="CIE 2000"))
    assert mean_delta_e([a], [b]) == pytest.approx(expected, rel=5e-3)
    assert mean_delta_e([a], [a]) == 0


def test_gradients_are_compared_with_what_two_references_share():
    generator = torch.Generator().manual_seed(0)

    def noise() -> torch.Tensor:
        return torch.randn(3, 64, 64, generator=generator)

    truth = noise()
    references = (truth + 0.5 * noise(), truth + 0.5 * noise())
    cosine, length = gradient_agreement(1.1 * truth, references)
    assert (cosine, length) == (pytest.approx(1, abs=0.03), pytest.approx(1.1, rel=0.03))
    cosine, length = gradient_agreement(truth + noise(), references)
    assert cosine == pytest.approx(0.5**0.5, abs=0.03)
    assert length == pytest.approx(1, rel=0.03)


def test_only_the_masks_pixels_count():
    image = torch.arange(12.0).reshape(1, 3, 2, 2)
    mask = np.array([[True, False], [False, True]])
    assert vehicle_pixels(image, mask).tolist() == [[0, 4, 8], [3, 7, 11]]
