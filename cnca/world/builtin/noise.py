"""Noise that repeats without a seam: what makes painted surfaces look used."""

from __future__ import annotations

import numpy as np
import scipy.fft
from jaxtyping import Float

Field = Float[np.ndarray, "height width"]


def fractal(
    shape: tuple[int, int],
    rng: np.random.Generator,
    *,
    smallest: float,
    largest: float,
    slope: float = 1.0,
    stretch: tuple[float, float] = (1.0, 1.0),
) -> Field:
    """Gaussian noise with an amplitude spectrum of frequency to the power of minus ``slope``.

    Args:
        smallest: shortest wavelength in texels.
        largest: longest wavelength in texels.
        stretch: how many times longer its features are down and across the picture.

    Returns:
        Mean 0, standard deviation 1, periodic in both directions.
    """
    down = np.abs(scipy.fft.fftfreq(shape[0]).astype(np.float32))[:, None] * stretch[0]
    across = scipy.fft.rfftfreq(shape[1]).astype(np.float32)[None] * stretch[1]
    frequency = np.hypot(down, across)
    wanted = (frequency <= 1 / smallest) & (frequency >= 1 / largest)
    amplitude = np.zeros_like(frequency)
    amplitude[wanted] = frequency[wanted] ** np.float32(-slope)
    # Noise in the frequencies themselves: one transform instead of two.
    phase = rng.random(frequency.shape, dtype=np.float32) * np.float32(2 * np.pi)
    spectrum = amplitude * (np.cos(phase) + np.complex64(1j) * np.sin(phase))
    noise = scipy.fft.irfft2(spectrum, shape)
    return (noise - noise.mean()) / max(float(noise.std()), 1e-12)


def step(field: Field, edge: float, width: float) -> Field:
    """0 below ``edge``, 1 above it, with a soft border of ``width``."""
    t = np.clip((field - edge) / width + 0.5, 0.0, 1.0)
    return t * t * (3 - 2 * t)


def mix(first: np.ndarray, second: np.ndarray, share: Field) -> np.ndarray:
    """Pictures (height, width, 3) or colors, ``share`` of the second."""
    return first + (second - first) * share[..., None]
