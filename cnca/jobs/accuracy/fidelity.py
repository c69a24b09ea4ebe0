"""How far pictures are from a reference, bias and noise apart.

Errors are relative to bright pixels and absolute in dark ones,

    error² = mean((L − L_ref)² / (L_ref² + 0.01)),

L exposed linear radiance, over pixels and colors (relMSE of Rousselle, Knaus & Zwicker 2011).
Neither picture nor reference is free of noise, so squares are products of *independent* renders:
their expectation is the square of what the renders have in common.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float
from torch import Tensor

DARK = 0.01
"""Squared radiance at which an error goes over from relative to absolute."""

Pixels = Float[np.ndarray, "pixels 3"]
"""Exposed linear RGB of the pixels that count."""


def vehicle_pixels(image: Float[Tensor, "1 3 h w"], mask: Bool[np.ndarray, "h w"]) -> Pixels:
    """The pixels of the one picture in ``image`` where ``mask`` holds, in double precision."""
    return image[0].permute(1, 2, 0).numpy()[mask].astype(np.float64)


def squared_bias(
    pictures: tuple[Pixels, Pixels], references: tuple[Pixels, Pixels]
) -> tuple[float, float]:
    """Squared bias and its standard error; the former falls below 0 where noise hides it.

    The first picture may share its random numbers with the first reference, the second with the
    second, but not with each other.
    """
    product = (pictures[0] - references[0]) * (pictures[1] - references[1])
    return mean_and_error(product * weight(references))


def squared_noise(pictures: tuple[Pixels, Pixels], references: tuple[Pixels, Pixels]) -> float:
    """Squared noise of each of two independent renders."""
    return float(((pictures[0] - pictures[1]) ** 2 / 2 * weight(references)).mean())


def mean_bias(found: Sequence[Pixels], references: Sequence[Pixels]) -> tuple[float, float]:
    """Relative difference of the mean radiance, and its standard error; all are independent."""
    true = float(np.mean(references))
    error = np.hypot(error_of_mean(found), error_of_mean(references))
    return float(np.mean(found)) / true - 1, float(error) / true


def error_of_mean(pictures: Sequence[Pixels]) -> float:
    """Standard error of the mean over independent pictures, whose pixels' noise is independent."""
    pixels = np.mean(pictures, axis=2)  # colors share their paths
    return float((pixels.var(axis=0, ddof=1).mean() / pixels.size) ** 0.5)


def squared_error(picture: Pixels, references: tuple[Pixels, Pixels]) -> tuple[float, float]:
    """Squared error, bias and noise together, and its standard error."""
    product = (picture - references[0]) * (picture - references[1])
    return mean_and_error(product * weight(references))


def root(square: float) -> float:
    """Square root that keeps the sign: an error below 0 is one that noise hides."""
    return float(np.sign(square) * np.sqrt(abs(square)))


def gradient_agreement(
    found: Float[Tensor, "3 h w"], references: tuple[Float[Tensor, "3 h w"], Float[Tensor, "3 h w"]]
) -> tuple[float, float]:
    """Cosine to the true gradient, and length along it relative to the true length.

    The true gradient's length is that which two independent references have in common.
    """
    a, b, g = (x.flatten().double() for x in (*references, found))
    length = float(a @ b) ** 0.5 if float(a @ b) > 0 else float("nan")
    along = float(g @ (a + b)) / 2 / length
    return along / float(g.norm()), along / length


def weight(references: tuple[Pixels, Pixels]) -> Pixels:
    """1 / (L_ref² + 0.01), L_ref the mean of both."""
    return 1 / (((references[0] + references[1]) / 2) ** 2 + DARK)


def mean_and_error(values: Pixels | Float[np.ndarray, " pixels"]) -> tuple[float, float]:
    """Mean and its standard error; colors of one pixel are not independent: it is of pixels."""
    pixels = values.reshape(len(values), -1).mean(axis=1)
    return float(pixels.mean()), float(pixels.std() / len(pixels) ** 0.5)
